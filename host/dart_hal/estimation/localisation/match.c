/* Gauss-Newton of `match_numpy` in matcher.py. `pose` is the start and becomes the result; `info` is
 * the information of the scan alone.
 *
 * p, q (n, 2) by rows: `points` and `rays`, the end points and their derivative by the scale; spread:
 * factor of sigma and C of each. patch: `Map.patch`, the distance at a node, its change by x, y and
 * x y, and the matrix of its gradient; left, low: `Map.origin`. c2: C squared, far: MAX_WALL_DISTANCE, sigma: WALL_DISTANCE_STD, strength: C^4 / sigma^2,
 * steps: MAX_ITERATIONS. h, g: normal equations, of order 4, positive definite as `known` is:
 * solved by Cholesky's method.
 */
#include <math.h>
#include <stdint.h>

static void solve(const double a[16], const double b[4], double x[4])
{
    double l[4][4];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j <= i; j++) {
            double s = a[4 * i + j];
            for (int k = 0; k < j; k++)
                s -= l[i][k] * l[j][k];
            l[i][j] = i == j ? sqrt(s) : s / l[j][j];
        }
    for (int i = 0; i < 4; i++) {
        double s = b[i];
        for (int k = 0; k < i; k++)
            s -= l[i][k] * x[k];
        x[i] = s / l[i][i];
    }
    for (int i = 3; i >= 0; i--) {
        double s = x[i];
        for (int k = i + 1; k < 4; k++)
            s -= l[k][i] * x[k];
        x[i] = s / l[i][i];
    }
}

void match(int64_t n, const double *restrict p, const double *restrict q,
           const double *restrict spread, int64_t rows, int64_t columns, const double *restrict patch,
           double left, double low, double cell, double c2, double far, double sigma,
           const double *restrict known, int64_t steps, double small, double *restrict pose,
           double *restrict info)
{
    const double start[4] = {pose[0], pose[1], pose[2], pose[3]};
    const double strength = c2 * c2 / (sigma * sigma);
    for (int64_t step = 0; step < steps; step++) {
        const double c = cos(pose[2]), s = sin(pose[2]);
        double h[16] = {0.0}, g[4] = {0.0};
        for (int64_t i = 0; i < n; i++) {
            const double qx = c * q[2 * i] - s * q[2 * i + 1], qy = s * q[2 * i] + c * q[2 * i + 1];
            const double rx = c * p[2 * i] - s * p[2 * i + 1] + pose[3] * qx;
            const double ry = s * p[2 * i] + c * p[2 * i + 1] + pose[3] * qy;
            const double u = fmin(fmax((rx + pose[0] - left) / cell, 0.0), columns - 1.001);
            const double v = fmin(fmax((ry + pose[1] - low) / cell, 0.0), rows - 1.001);
            const int64_t iu = (int64_t)u, iv = (int64_t)v;
            const double *f = patch + 7 * (iv * columns + iu), du = u - iu, dv = v - iv;
            const double grow = f[2] + f[3] * du;
            const double d = f[0] + f[1] * du + grow * dv;
            const double along = f[1] + f[3] * dv;
            const double gx = (f[4] * along + f[5] * grow) / cell;
            const double gy = (f[5] * along + f[6] * grow) / cell;
            const double wider = spread[i] * spread[i], e = c2 * wider + d * d;
            const double w = d <= far ? strength * wider / (e * e) : 0.0;
            const double j[4] = {gx, gy, gy * rx - gx * ry, gx * qx + gy * qy};
            for (int a = 0; a < 4; a++) {
                g[a] += w * j[a] * d;
                for (int b = 0; b <= a; b++)
                    h[4 * a + b] += w * j[a] * j[b];
            }
        }
        double whole[16], right[4], move[4], most = 0.0;
        for (int a = 0; a < 4; a++) {
            right[a] = -g[a];
            for (int b = 0; b < 4; b++) {
                info[4 * a + b] = h[a > b ? 4 * a + b : 4 * b + a];
                whole[4 * a + b] = info[4 * a + b] + known[4 * a + b];
                right[a] -= known[4 * a + b] * (pose[b] - start[b]);
            }
        }
        solve(whole, right, move);
        for (int a = 0; a < 4; a++) {
            pose[a] += move[a];
            most = fmax(most, fabs(move[a]));
        }
        if (most < small)
            break;
    }
}
