/* Distances from points along unit vectors to the first of many lines. Determinants and limits are
 * those of rays.py. A line goes from (ax, ay) over (ex, ey). `cast` tries all lines; its loop has
 * no branch, so that it becomes vectors. `cast_grid` tries those in the cells that a ray passes.
 */
#include <math.h>
#include <stdint.h>

/* far: distance of a ray that meets none; slack: LINE_EXTENSION, parallel: MIN_LENGTH_ACROSS,
 * least: MIN_HIT_DISTANCE.
 */
struct limits {
    double far, slack, parallel, least;
};

/* Distance to a line from (rx, ry) over (ex, ey), seen from the start of the ray. */
static inline double meet(double rx, double ry, double ex, double ey, double dx, double dy,
                          const struct limits *l)
{
    double den = dx * ey - dy * ex;
    den = fabs(den) < l->parallel ? 1e-300 : den;
    const double inverse = 1.0 / den;
    const double t = (rx * ey - ry * ex) * inverse, u = (rx * dy - ry * dx) * inverse;
    return (t > l->least) & (u >= -l->slack) & (u <= 1.0 + l->slack) ? t : l->far;
}

void cast(int64_t n, const double *restrict origin, const double *restrict direction,
          double *restrict out, const struct limits *l, int64_t m, const double *restrict ax,
          const double *restrict ay, const double *restrict ex, const double *restrict ey)
{
    for (int64_t i = 0; i < n; i++) {
        const double ox = origin[2 * i], oy = origin[2 * i + 1];
        const double dx = direction[2 * i], dy = direction[2 * i + 1];
        double best = l->far;
#pragma omp simd reduction(min : best)
        for (int64_t j = 0; j < m; j++)
            best = fmin(best, meet(ax[j] - ox, ay[j] - oy, ex[j], ey[j], dx, dy, l));
        out[i] = best;
    }
}

/* Cell i has the blocks first[i] to first[i + 1] of four lines: ax, ay, ex, ey of each. jump: for
 * each quadrant of directions, the number of columns and rows of the largest empty square that
 * begins at a cell and extends into this quadrant; 0: the cell has lines.
 */
struct grid {
    double left, low, side;
    int64_t rows, columns;
    const uint8_t *jump;
    const int32_t *first;
    const double *block;
};

/* A ray in the grid. Its place, speed and cell are in cells, mirrored to increase along the ray. */
struct ray {
    double ox, oy, dx, dy, px, py, vx, vy, ix, iy, best;
    int64_t c, r, corner, by_c, by_r;
    const uint8_t *square;
};

/* Rays that advance in turn: while one waits for its next cell, the others compute. */
#define TOGETHER 4

static inline int is_inside(const struct ray *a, const struct grid *g)
{
    return ((uint64_t)a->c < (uint64_t)g->columns) & ((uint64_t)a->r < (uint64_t)g->rows);
}

/* The ray in the cell where it starts or enters the grid. Return whether there is one. */
static inline int enter(struct ray *a, const double *origin, const double *direction,
                        const struct limits *l, const struct grid *g, double per)
{
    a->ox = origin[0];
    a->oy = origin[1];
    a->dx = direction[0];
    a->dy = direction[1];
    const double x = (a->ox - g->left) * per, y = (a->oy - g->low) * per;
    const int left = a->dx < 0.0, down = a->dy < 0.0;
    a->px = left ? g->columns - x : x;
    a->py = down ? g->rows - y : y;
    /* Speed [cells/m] and its inverse, which is huge along a side. */
    a->vx = fmax(fabs(a->dx), 1e-12) * per;
    a->vy = fmax(fabs(a->dy), 1e-12) * per;
    const double inverse = 1.0 / (a->vx * a->vy);
    a->ix = a->vy * inverse;
    a->iy = a->vx * inverse;
    a->square = g->jump + (left + 2 * down) * g->rows * g->columns;
    a->corner = (left ? g->columns - 1 : 0) + (down ? (g->rows - 1) * g->columns : 0);
    a->by_c = left ? -1 : 1;
    a->by_r = down ? -g->columns : g->columns;
    a->best = l->far;
    const double t = fmax(fmax(-a->px * a->ix, -a->py * a->iy), 0.0);
    a->c = (int64_t)fmin(fmax(a->px + t * a->vx, 0.0), g->columns);
    a->r = (int64_t)fmin(fmax(a->py + t * a->vy, 0.0), g->rows);
    return is_inside(a, g);
}

/* Try the lines of the cell, or skip the empty square from it on. Return whether to go on.
 *
 * The ray leaves through the side that it reaches first. The index across this side is exact; the
 * other is computed from the distance, and is kept within the square, so that rounding cannot turn
 * the ray back.
 */
static inline int step(struct ray *a, const struct limits *l, const struct grid *g)
{
    const int64_t at = a->corner + a->by_c * a->c + a->by_r * a->r;
    const int64_t size = a->square[at], k = size ? size : 1;
    const int64_t next_c = a->c + k, next_r = a->r + k;
    const double tx = (next_c - a->px) * a->ix, ty = (next_r - a->py) * a->iy;
    const double t = tx < ty ? tx : ty;
    if (!size) {
        double best = a->best;
        for (int64_t j = g->first[at]; j < g->first[at + 1]; j++) {
            const double *ax = g->block + 16 * j, *ay = ax + 4, *ex = ay + 4, *ey = ex + 4;
#pragma omp simd reduction(min : best)
            for (int64_t i = 0; i < 4; i++)
                best = fmin(best, meet(ax[i] - a->ox, ay[i] - a->oy, ex[i], ey[i], a->dx, a->dy,
                                       l));
        }
        a->best = best;
        if (best <= t)
            return 0;
    }
    const int64_t cx = (int64_t)(a->px + t * a->vx), cy = (int64_t)(a->py + t * a->vy);
    const int64_t nc = cx < a->c ? a->c : cx >= next_c ? next_c - 1 : cx;
    const int64_t nr = cy < a->r ? a->r : cy >= next_r ? next_r - 1 : cy;
    a->c = tx < ty ? next_c : nc;
    a->r = tx < ty ? nr : next_r;
    return is_inside(a, g);
}

void cast_grid(int64_t n, const double *restrict origin, const double *restrict direction,
               double *restrict out, const struct limits *l, const struct grid *grid)
{
    const struct grid copy = *grid, *g = &copy;
    const double per = 1.0 / g->side;
    for (int64_t i = 0; i < n; i += TOGETHER) {
        struct ray a[TOGETHER];
        int on[TOGETHER], all = 1;
        for (int k = 0; k < TOGETHER; k++) {
            const int64_t j = i + k < n ? i + k : n - 1;
            on[k] = enter(a + k, origin + 2 * j, direction + 2 * j, l, g, per);
            all &= on[k];
        }
        while (all)
#pragma GCC unroll 8
            for (int k = 0; k < TOGETHER; k++) {
                on[k] = step(a + k, l, g);
                all &= on[k];
            }
        for (int k = 0; k < TOGETHER && i + k < n; k++) {
            while (on[k])
                on[k] = step(a + k, l, g);
            out[i + k] = a[k].best;
        }
    }
}
