/*
 * Heights that bend, quadratic with a small cubic part, against sums over many small triangles: what of the
 * distance is integrated, and how its shares grow cell by cell.
 */
#include "check.h"

#include <math.h>

#include "deviation/deviation_integral.h"
#include "deviation/deviation_sum.h"
#include "random.h"

enum { GRID = 64, PLACES = 12, FINE = 300 };

#define SPARE 0.02 /* what a sum over the grid is off by is less */

/** A quadratic function at weights, term by term. */
static double value_at(const double value[6], const double l[3])
{
    return l[0] * l[0] * value[0] + l[1] * l[1] * value[1] + l[2] * l[2] * value[2] +
           2.0 * (l[0] * l[1] * value[3] + l[1] * l[2] * value[4] + l[2] * l[0] * value[5]);
}

/** The cubic part at weights, by its coefficients: those of l_i^2 l_j and l_i l_j^2 are opposite numbers. */
static double cubic_at(const double cubic[4], const double l[3])
{
    double sum = 6.0 * l[0] * l[1] * l[2] * cubic[3];
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3;
        sum += 3.0 * l[i] * l[i] * l[j] * cubic[i] - 3.0 * l[i] * l[j] * l[j] * cubic[i];
    }
    return sum;
}

/** The middles of the triangles of the grid: GRID * GRID of them. */
static void middle_of(int place, double l[3])
{
    int row = 0, left = place;
    while (left >= 2 * (GRID - row) - 1)
        left -= 2 * (GRID - row++) - 1;
    double third = left % 2 ? 2.0 / 3.0 : 1.0 / 3.0;
    l[1] = ((double)(left / 2) + third) / GRID;
    l[2] = (row + third) / GRID;
    l[0] = 1.0 - l[1] - l[2];
}

static double greatest_of(const double *x, int count)
{
    double greatest = 0.0;
    for (int i = 0; i < count; i++)
        greatest = fmax(greatest, fabs(x[i]));
    return greatest;
}

typedef struct bent_piece {
    qm_deviation_shape shape;
    qm_deviation_bounds bounds;
    double value[6], cubic[4], cubic_most, below, above;
} bent_piece;

static bent_piece draw_piece(qm_random *random)
{
    bent_piece piece = {.cubic_most = 0.0};
    double scale = 0.1 * (double)qm_random_below(random, 3);
    for (int k = 0; k < 4; k++)
        piece.cubic[k] = scale * qm_random_range(random, -1.0, 1.0);
    piece.cubic_most = qm_quadratic_cubic_most(piece.cubic);
    piece.below = piece.cubic_most + SPARE + qm_random_range(random, 0.0, 0.1);
    piece.above = piece.cubic_most + SPARE + qm_random_range(random, 0.0, 0.1);
    double middle = qm_random_range(random, -1.0, 1.0) * (double)qm_random_below(random, 3), open[2];
    for (int k = 0; k < 6; k++)
        piece.value[k] = middle + qm_random_range(random, -1.0, 1.0);
    piece.shape.is_uniform = qm_random_below(random, 2) == 0;
    double density = qm_random_range(random, 0.5, 2.0);
    for (int i = 0; i < 3; i++)
        piece.shape.low[i] = piece.shape.high[i] =
            piece.shape.is_uniform ? density : qm_random_range(random, 0.5, 2.0);
    qm_quadratic_linear_error(piece.value, open);
    piece.bounds.bend.below = piece.below;
    piece.bounds.bend.above = piece.above;
    piece.bounds.bend.cubic_most = piece.cubic_most;
    for (int k = 0; k < 4; k++)
        piece.bounds.bend.cubic[k] = piece.cubic[k];
    piece.bounds.bend.cells = 2 + (int)qm_random_below(random, QM_QUADRATIC_CELLS - 1);
    for (int k = 0; k < 6; k++)
        piece.bounds.bend.value[k] = piece.value[k];
    for (int i = 0; i < 3; i++) {
        piece.bounds.low[i] = piece.value[i] - open[0] - piece.below;
        piece.bounds.high[i] = piece.value[i] + open[1] + piece.above;
    }
    qm_deviation_integrate_quadratic(&piece.shape, (qm_positive_part){0.0, 0.0, 0.0},
                                     (qm_excess){.most = 0.0}, 0.0, 1e-3, &piece.bounds);
    return piece;
}

/** The distance is the size of any number between the two functions. The cubic part is no greater than its
 * bound, and leaves nothing open but where the height changes its sign. */
static void check_integrals(const bent_piece *piece, qm_random *random, uint64_t number)
{
    double shift =
        qm_random_range(random, piece->cubic_most - piece->below, piece->above - piece->cubic_most);
    double mean = 0.0, square = 0.0, area = 0.0, least = INFINITY;
    for (int place = 0; place < GRID * GRID; place++) {
        double l[3];
        middle_of(place, l);
        double cubic = cubic_at(piece->cubic, l), d = fabs(value_at(piece->value, l) + cubic + shift);
        QM_CHECK(fabs(cubic) <= piece->cubic_most * (1.0 + 1e-12), "seed %llu, piece %llu: %.17g of %.17g",
                 (unsigned long long)qm_check_seed(), (unsigned long long)number, cubic, piece->cubic_most);
        double part = (l[0] * piece->shape.low[0] + l[1] * piece->shape.low[1] + l[2] * piece->shape.low[2]) /
                      (GRID * GRID);
        area += part;
        mean += part * d;
        square += part * d * d;
    }
    double most = greatest_of(piece->value, 6) + 0.2 + 2.0 * piece->cubic_most, spare = SPARE * area;
    const qm_deviation_bounds *bounds = &piece->bounds;
    QM_CHECK(bounds->mean_low <= mean + spare && bounds->mean_high >= mean - spare,
             "seed %llu, piece %llu: mean [%.17g, %.17g] against %.17g", (unsigned long long)qm_check_seed(),
             (unsigned long long)number, bounds->mean_low, bounds->mean_high, mean);
    QM_CHECK(bounds->square_low <= square + 2.0 * most * spare &&
                 bounds->square_high >= square - 2.0 * most * spare,
             "seed %llu, piece %llu: square [%.17g, %.17g] against %.17g",
             (unsigned long long)qm_check_seed(), (unsigned long long)number, bounds->square_low,
             bounds->square_high, square);
    double open = bounds->density_high * (2.0 * (piece->below + piece->above) + SPARE);
    QM_CHECK(bounds->mean_high - bounds->mean_low <= open,
             "seed %llu, piece %llu: %.17g is left open of %.17g", (unsigned long long)qm_check_seed(),
             (unsigned long long)number, bounds->mean_high - bounds->mean_low, open);
    for (int k = 0; k < 6; k++)
        least = fmin(least, fabs(piece->value[k]));
    bool has_one_sign = true;
    for (int k = 1; k < 6; k++)
        has_one_sign &= (piece->value[k] > 0.0) == (piece->value[0] > 0.0);
    if (!has_one_sign || least < fmax(piece->below, piece->above)) return;
    double width = (piece->below + piece->above - 2.0 * piece->cubic_most) * bounds->area_high;
    QM_CHECK(bounds->mean_high - bounds->mean_low <= width * (1.0 + 1e-9),
             "seed %llu, piece %llu: %.17g is left open of %.17g on one side",
             (unsigned long long)qm_check_seed(), (unsigned long long)number,
             bounds->mean_high - bounds->mean_low, width);
}

/** The share of the grid's triangles in which the height is at most x when it is moved so far towards 0. */
static double share_of_grid(const bent_piece *piece, double x, double nearer)
{
    double within = 0.0, area = 0.0;
    for (int place = 0; place < GRID * GRID; place++) {
        double l[3];
        middle_of(place, l);
        double part = l[0] * piece->shape.low[0] + l[1] * piece->shape.low[1] + l[2] * piece->shape.low[2];
        area += part;
        if (fabs(value_at(piece->value, l)) - nearer <= x) within += part;
    }
    return within / area;
}

/** In a triangle of the grid a height is as far from that at its middle as it can get on a third of an
 * edge. */
static void check_shares(const bent_piece *piece, uint64_t number)
{
    double x[PLACES], open[2], most = greatest_of(piece->value, 6), steep = 8.0 * most / GRID;
    long double work[QM_SHARE_ROWS * (PLACES + 1)];
    qm_interval share[PLACES];
    qm_deviation_piece_list list = {&piece->bounds, 1, 0.0, INFINITY};
    for (int i = 0; i < PLACES; i++)
        x[i] = (most + 0.2) * i / (PLACES - 1);
    qm_context ctx = qm_context_make();
    QM_CHECK(qm_deviation_shares(&ctx, list, x, PLACES, work, share) == QM_OK, "shares failed");
    qm_quadratic_linear_error(piece->value, open);
    double cells = piece->bounds.bend.cells, wide = piece->below + piece->above;
    double blur = wide + (open[0] + open[1]) / (cells * cells) + steep;
    for (int i = 0; i < PLACES; i++) {
        QM_CHECK(share[i].lower <= share_of_grid(piece, x[i], steep) + 1e-9 &&
                     share[i].upper >= share_of_grid(piece, x[i], -steep) - 1e-9,
                 "seed %llu, piece %llu: share within %g in [%.17g, %.17g]",
                 (unsigned long long)qm_check_seed(), (unsigned long long)number, x[i], share[i].lower,
                 share[i].upper);
        /* Where the density changes, no more is known of a cell than the least and the greatest. */
        if (!piece->shape.is_uniform) continue;
        QM_CHECK(share[i].lower >= share_of_grid(piece, x[i], -blur) - 1e-9 &&
                     share[i].upper <= share_of_grid(piece, x[i], blur) + 1e-9,
                 "seed %llu, piece %llu: share within %g only in [%.17g, %.17g]",
                 (unsigned long long)qm_check_seed(), (unsigned long long)number, x[i], share[i].lower,
                 share[i].upper);
    }
}

static void heights_that_bend_hold(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 10000 : 200;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 810000 + number);
        bent_piece piece = draw_piece(&random);
        check_integrals(&piece, &random, number);
        check_shares(&piece, number);
    }
}

/** The greatest values of single terms are known to five digits: no bound is below, or far above. */
static void bounds_of_single_terms_are_tight(void **state)
{
    (void)state;
    double most[4] = {0.0, 0.0, 0.0, 0.0}, off[3] = {0.0, 0.0, 0.0}, bound, open[2];
    for (int i = 0; i <= FINE; i++)
        for (int j = 0; i + j <= FINE; j++) {
            const double l[3] = {(double)i / FINE, (double)j / FINE, (double)(FINE - i - j) / FINE};
            for (int k = 0; k < 4; k++) {
                double cubic[4] = {0.0, 0.0, 0.0, 0.0};
                cubic[k] = 1.0;
                most[k] = fmax(most[k], fabs(cubic_at(cubic, l)));
            }
            off[0] = fmax(off[0], 2.0 * l[0] * l[1]);
            off[1] = fmax(off[1], 2.0 * (l[0] * l[1] + l[1] * l[2]));
            off[2] = fmax(off[2], 2.0 * (l[0] * l[1] + l[1] * l[2] + l[2] * l[0]));
        }
    for (int k = 0; k < 4; k++) {
        double cubic[4] = {0.0, 0.0, 0.0, 0.0};
        cubic[k] = -1.0;
        bound = qm_quadratic_cubic_most(cubic);
        QM_CHECK(bound >= most[k] && bound <= most[k] + 2e-4, "term %d: %.17g, bound %.17g", k, most[k],
                 bound);
    }
    for (int count = 1; count <= 3; count++) {
        double value[6] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
        for (int k = 0; k < count; k++)
            value[3 + k] = 1.0;
        qm_quadratic_linear_error(value, open);
        QM_CHECK(open[1] >= off[count - 1] - 1e-12 && open[0] == 0.0, "%d edges: %.17g, bound %.17g", count,
                 off[count - 1], open[1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(heights_that_bend_hold),
        cmocka_unit_test(bounds_of_single_terms_are_tight),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
