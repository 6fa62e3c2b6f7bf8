/* Some iterations of the splitting of admm.py on z and y, in place: see `run_sweep` there.
 * c (m, n) and to_x (n, m) are stored row by row. Names here and there: times: iterations,
 * apart: z - y, there: relaxed, beyond: excess, most: max_push. */
#include <stdint.h>

#define MOST 512 /* largest n and m; the caller checks them */

static double within(double x, double low, double high)
{
    return x < low ? low : x > high ? high : x;
}

void run_sweep(int64_t times, int64_t n, int64_t m, double relaxation, const double *c,
           const double *to_x, const double *offset, const double *low, const double *high,
           const double *most, double *z, double *y)
{
    double apart[MOST], x[MOST];
    while (times-- > 0) {
        for (int64_t i = 0; i < m; i++)
            apart[i] = z[i] - y[i];
        for (int64_t k = 0; k < n; k++) {
            double sum = -offset[k];
            for (int64_t i = 0; i < m; i++)
                sum += to_x[k * m + i] * apart[i];
            x[k] = sum;
        }
        for (int64_t i = 0; i < m; i++) {
            double sum = 0.0;
            for (int64_t k = 0; k < n; k++)
                sum += c[i * n + k] * x[k];
            const double there = relaxation * sum + (1.0 - relaxation) * z[i] + y[i];
            const double inside = within(there, low[i], high[i]);
            const double beyond = there - inside;
            z[i] = inside + beyond - within(beyond, -most[i], most[i]);
            y[i] = there - z[i];
        }
    }
}
