#include "max_min.h"

#include "vec.h"

#define MAX_CHANGES 32          /* of the basis */
#define ROUNDING 0x1p-40        /* below it a weight is none, and of the radius a height */
#define HEIGHT_ROUNDING 0x1p-50 /* of the heights: a difference below it is none */

/** A slope as the column (slope, 1 or 0 for a wall) of the dual program, and its height. */
typedef struct column {
    qm_vec a;
    double height;
} column;

/** Three columns whose weights (>= 0) sum to (0, 0, 1), by their cross products. */
typedef struct basis {
    column at[3];
    qm_vec cross[3];
    double determinant;
} basis;

static const double directions[3][2] = {{1.0, 0.0}, {-0.5, 0.8660254037844386}, {-0.5, -0.8660254037844386}};

/** The slopes, and after them the sides of the triangle. */
static column column_of(const qm_slope *slopes, int count, double radius, int i)
{
    if (i >= count) return (column){{-directions[i - count][0], -directions[i - count][1], 0.0}, radius};
    const qm_slope *s = &slopes[i];
    return (column){{s->slope[0], s->slope[1], s->is_wall ? 0.0 : 1.0}, s->height};
}

static void find_crosses(basis *b)
{
    for (int i = 0; i < 3; i++)
        b->cross[i] = qm_vec_cross(b->at[(i + 1) % 3].a, b->at[(i + 2) % 3].a);
    b->determinant = qm_vec_dot(b->at[0].a, b->cross[0]);
}

/** The first slope, and the two sides of the triangle that it leads to. */
static void start(basis *b, const qm_slope *slopes, int count, double radius)
{
    int out = 0;
    double least = INFINITY;
    for (int i = 0; i < 3; i++) {
        double along = slopes[0].slope[0] * directions[i][0] + slopes[0].slope[1] * directions[i][1];
        if (along < least) {
            least = along;
            out = i;
        }
    }
    b->at[0] = column_of(slopes, count, radius, 0);
    for (int k = 1; k < 3; k++)
        b->at[k] = column_of(slopes, count, radius, count + (out + k) % 3);
    find_crosses(b);
}

/** Lets a column in for the one that it drives out first. False when there is none. */
static bool change(basis *b, column entering)
{
    int leaving = -1;
    double least = INFINITY;
    for (int i = 0; i < 3; i++) {
        double weight = b->cross[i].z / b->determinant;
        double share = qm_vec_dot(b->cross[i], entering.a) / b->determinant;
        if (!(share > ROUNDING) || !(weight < least * share)) continue;
        least = weight / share;
        leaving = i;
    }
    if (leaving < 0) return false;
    b->at[leaving] = entering;
    find_crosses(b);
    return b->determinant != 0.0;
}

/** Where the three meet: (x, y, -t). */
static qm_vec meeting(const basis *b)
{
    qm_vec sum = {0, 0, 0};
    for (int i = 0; i < 3; i++)
        sum = qm_vec_axpy(sum, -b->at[i].height / b->determinant, b->cross[i]);
    return sum;
}

double qm_max_min(const qm_slope *slopes, int count, double radius, double at[2])
{
    basis b;
    start(&b, slopes, count, radius);
    for (int changes = 0; changes < MAX_CHANGES; changes++) {
        qm_vec top = meeting(&b);
        double lowest = -fmax(ROUNDING * radius, HEIGHT_ROUNDING * fabs(slopes[0].height));
        int entering = -1;
        for (int i = 0; i < count + 3; i++) {
            column c = column_of(slopes, count, radius, i);
            double room = c.height + qm_vec_dot(c.a, top);
            if (room >= lowest) continue;
            lowest = room;
            entering = i;
        }
        if (entering < 0) {
            at[0] = top.x;
            at[1] = top.y;
            return -top.z;
        }
        if (!change(&b, column_of(slopes, count, radius, entering))) break;
    }
    at[0] = at[1] = 0.0;
    return slopes[0].height;
}
