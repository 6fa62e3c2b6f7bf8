/* Distance from (ox, oy) along the unit vector (dx, dy) to the first of m lines, for n rays.
 *
 * A line goes from (ax, ay) over (ex, ey); `far` where a ray meets none. The determinants are
 * those of rays.py; the loop over lines has no branch, so that it becomes vectors.
 */
#include <stdint.h>

void cast(int64_t n, int64_t m, double far, double slack,
          const double *restrict ox, const double *restrict oy,
          const double *restrict dx, const double *restrict dy,
          const double *restrict ax, const double *restrict ay,
          const double *restrict ex, const double *restrict ey, double *restrict out)
{
    for (int64_t i = 0; i < n; i++) {
        const double px = ox[i], py = oy[i], vx = dx[i], vy = dy[i];
        double best = far;
#pragma omp simd reduction(min : best)
        for (int64_t j = 0; j < m; j++) {
            const double rx = ax[j] - px, ry = ay[j] - py;
            double den = vx * ey[j] - vy * ex[j];
            den = den == 0.0 ? 1e-300 : den;
            const double t = (rx * ey[j] - ry * ex[j]) / den;
            const double u = (rx * vy - ry * vx) / den;
            const double hit = (t > 0.0) & (u >= -slack) & (u <= 1.0 + slack) ? t : far;
            best = hit < best ? hit : best;
        }
        out[i] = best;
    }
}
