/*
 * The highest point below planes, against all points in which three of them or of the walls meet: random
 * ones, and such as come up in a corner of a face, where walls go through the place and planes are alike.
 */
#include <math.h>
#include <string.h>

#include "check.h"
#include "core/linear.h"
#include "random.h"

#define MAX_SLOPES 19
#define ERROR 1e-9

/** Adds the sides of the triangle, as walls. */
static int with_sides(const qm_max_min_plane *slopes, int count, double radius, qm_max_min_plane *all)
{
    memcpy(all, slopes, (size_t)count * sizeof *all);
    for (int k = 0; k < 3; k++) {
        double angle = 2.0 * k * acos(-1.0) / 3.0;
        all[count + k] = (qm_max_min_plane){{-cos(angle), -sin(angle)}, radius, true};
    }
    return count + 3;
}

static double room(const qm_max_min_plane *s, const double x[3])
{
    return s->height + s->slope[0] * x[0] + s->slope[1] * x[1] - (s->is_bound ? 0.0 : x[2]);
}

/** Where three meet: x, y, t; false when they do so nowhere or everywhere. */
static bool meet(const qm_max_min_plane *const s[3], double x[3])
{
    double m[3][4];
    for (int i = 0; i < 3; i++) {
        m[i][0] = s[i]->slope[0];
        m[i][1] = s[i]->slope[1];
        m[i][2] = s[i]->is_bound ? 0.0 : -1.0;
        m[i][3] = -s[i]->height;
    }
    for (int k = 0; k < 3; k++) {
        int best = k;
        for (int i = k; i < 3; i++)
            if (fabs(m[i][k]) > fabs(m[best][k])) best = i;
        if (fabs(m[best][k]) < 1e-12) return false;
        for (int j = 0; j < 4; j++) {
            double swapped = m[k][j];
            m[k][j] = m[best][j];
            m[best][j] = swapped;
        }
        for (int i = 0; i < 3; i++) {
            if (i == k) continue;
            double share = m[i][k] / m[k][k];
            for (int j = k; j < 4; j++)
                m[i][j] -= share * m[k][j];
        }
    }
    for (int k = 0; k < 3; k++)
        x[k] = m[k][3] / m[k][k];
    return true;
}

static double highest_by_all_triples(const qm_max_min_plane *slopes, int count)
{
    double highest = -INFINITY;
    for (int i = 0; i < count; i++)
        for (int j = 0; j < i; j++)
            for (int k = 0; k < j; k++) {
                const qm_max_min_plane *three[3] = {&slopes[i], &slopes[j], &slopes[k]};
                double x[3];
                if (!meet(three, x) || !(x[2] > highest)) continue;
                bool below = true;
                for (int n = 0; n < count && below; n++)
                    below = room(&slopes[n], x) >= -1e-11;
                if (below) highest = x[2];
            }
    return highest;
}

static void check_one(const qm_max_min_plane *slopes, int count, double radius, int number)
{
    qm_max_min_plane all[MAX_SLOPES + 3];
    int total = with_sides(slopes, count, radius, all);
    double x[3];
    x[2] = qm_linear_max_min(slopes, count, radius, x);
    double expected = highest_by_all_triples(all, total);
    QM_CHECK(fabs(x[2] - expected) <= ERROR * (1.0 + radius), "seed %llu, case %d: %.17g, not %.17g",
             (unsigned long long)qm_check_seed(), number, x[2], expected);
    for (int i = 0; i < total; i++)
        QM_CHECK(room(&all[i], x) >= -ERROR * (1.0 + radius), "seed %llu, case %d: slope %d of %d by %g",
                 (unsigned long long)qm_check_seed(), number, i, total, room(&all[i], x));
}

static qm_max_min_plane random_slope(qm_random *random, double spread)
{
    return (qm_max_min_plane){{qm_random_range(random, -1.0, 1.0), qm_random_range(random, -1.0, 1.0)},
                              spread * qm_random_range(random, 0.0, 1.0),
                              false};
}

static void random_planes_and_walls(void **state)
{
    (void)state;
    for (int number = 0; number < 1500; number++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)number);
        qm_max_min_plane slopes[MAX_SLOPES];
        int planes = 1 + (int)qm_random_below(&random, 12), count = 0;
        double spread = qm_random_below(&random, 2) ? 1.0 : 1e-3;
        while (count < planes)
            slopes[count++] = random_slope(&random, spread);
        for (int walls = (int)qm_random_below(&random, 5); walls > 0; walls--) {
            slopes[count] = random_slope(&random, qm_random_below(&random, 2) ? 1.0 : 0.0);
            slopes[count++].is_bound = true;
        }
        check_one(slopes, count, pow(10.0, qm_random_range(&random, -6.0, 1.0)), number);
    }
}

/** A corner or an edge of a square or a triangle, with planes some of which are the same, level or steep. */
static void places_where_many_meet(void **state)
{
    (void)state;
    for (int number = 0; number < 1500; number++) {
        qm_random random = qm_random_make(qm_check_seed() + 1, (uint64_t)number);
        qm_max_min_plane slopes[MAX_SLOPES];
        int planes = 1 + (int)qm_random_below(&random, 12), count = 0;
        while (count < planes) {
            qm_max_min_plane s = random_slope(&random, 0.0);
            switch (qm_random_below(&random, 4)) {
            case 0:
                s.slope[0] = 0.0;
                break;
            case 1:
                s.slope[1] = s.slope[0];
                break;
            case 2:
                s = slopes[qm_random_below(&random, (size_t)count + 1) % (size_t)(count > 0 ? count : 1)];
                break;
            default:
                break;
            }
            if (count == 0) s = random_slope(&random, 0.0);
            s.height = 1.0;
            slopes[count++] = s;
        }
        double u = (double)qm_random_below(&random, 3) / 2.0, v = (double)qm_random_below(&random, 3) / 2.0;
        slopes[count++] = (qm_max_min_plane){{1.0, 0.0}, u, true};
        slopes[count++] = (qm_max_min_plane){{0.0, 1.0}, v, true};
        slopes[count++] = (qm_max_min_plane){{-1.0, 0.0}, 1.0 - u, true};
        slopes[count++] = (qm_max_min_plane){{0.0, -1.0}, 1.0 - v, true};
        check_one(slopes, count, pow(10.0, qm_random_range(&random, -6.0, 1.0)), number);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_planes_and_walls),
        cmocka_unit_test(places_where_many_meet),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
