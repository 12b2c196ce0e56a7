/**
 * deviation_match.c: finds the parameters of a match by a few Newton steps, then bounds its coefficients. The
 * parameters need not be footpoints: any affine map is valid, and the bounds are as good as it is near.
 */
#include "deviation_match.h"

#include "core/rounding.h"

#define STEPS 8            /* of Newton's method for one foot */
#define BEYOND 0.5         /* of the parameters: how far a match may leave the unit square */
#define CLOSE_STEP 0x1p-16 /* a step that is shorter is the last one: what it is off by falls to its square */
#define CLEAR 0.125        /* least m that is worth a bound */
#define LEAST_SINE 0x1p-10 /* of a frame: between a and the length of its columns */
#define RELATIVE (1.0 + 0x1p-40) /* for the roundings of a few dozen operations on positive terms */
#define LEAST_NORMAL 0x1p-5      /* of the longest normal: heights are along normals that are no shorter */
#define FOOT_ROUNDING 0x1p-50    /* of the parameters b + z */
#define MOST_PAIRS 0.66667       /* of the sum of 2 l_i l_j over i < j */
#define FARTHEST 4.0             /* of the greatest coordinate: differences beyond are not bounded */

/** The corners of the piece that coefficient k belongs to. */
static const int pair_of[6][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {2, 0}};

/* ---- feet ---- */

/** Keeps a step within the square: parameters on an edge stay there if the step leads beyond it. */
static double clamp_to(double x, bool within)
{
    return within ? qm_clamp(x, 0.0, 1.0) : qm_clamp(x, -BEYOND, 1.0 + BEYOND);
}

/** Newton's step for |p - Q|^2 / 2, or that of Gauss and Newton where the function is not convex; along one
 * parameter alone where the other is held by an edge. */
static void find_step(const qm_bilinear *q, qm_vec p, const double at[2], bool within, double step[2])
{
    qm_vec along_s = qm_vec_axpy(q->e1, at[1], q->w), along_t = qm_vec_axpy(q->e2, at[0], q->w);
    qm_vec d = qm_vec_sub(p, qm_bilinear_at(q, at[0], at[1]));
    double ss = qm_vec_norm2(along_s), tt = qm_vec_norm2(along_t), st = qm_vec_dot(along_s, along_t);
    double fs = qm_vec_dot(d, along_s), ft = qm_vec_dot(d, along_t), bent = st - qm_vec_dot(d, q->w);
    bool held[2] = {within && ((at[0] <= 0.0 && fs <= 0.0) || (at[0] >= 1.0 && fs >= 0.0)),
                    within && ((at[1] <= 0.0 && ft <= 0.0) || (at[1] >= 1.0 && ft >= 0.0))};
    if (ss * tt - bent * bent > 0x1p-8 * ss * tt) st = bent;
    double determinant = ss * tt - st * st;
    step[0] = step[1] = 0.0;
    if (held[0] || held[1] || !(determinant > 0.0)) {
        if (!held[0] && ss > 0.0) step[0] = fs / ss;
        if (!held[1] && tt > 0.0) step[1] = ft / tt;
        if (!held[0] && !held[1]) step[fs * fs * tt < ft * ft * ss ? 0 : 1] = 0.0;
    } else {
        step[0] = (tt * fs - st * ft) / determinant;
        step[1] = (ss * ft - st * fs) / determinant;
    }
}

void qm_deviation_match_foot(const qm_bilinear *patch, qm_vec p, bool within, double at[2])
{
    at[0] = clamp_to(at[0], within);
    at[1] = clamp_to(at[1], within);
    for (int i = 0; i < STEPS; i++) {
        double step[2], before[2] = {at[0], at[1]};
        find_step(patch, p, at, within, step);
        for (int k = 0; k < 2; k++)
            at[k] = clamp_to(at[k] + step[k], within);
        if (fabs(at[0] - before[0]) + fabs(at[1] - before[1]) < CLOSE_STEP) break;
    }
}

/* ---- coefficients ---- */

/** A unit vector that differences of feet are along: the normal of the patch; for points beside it that of
 * the differences themselves. */
static qm_vec find_direction(const qm_deviation_match *match)
{
    qm_vec direction = {0, 0, 0};
    if (!match->is_clamped)
        for (int i = 0; i < 3; i++)
            direction = qm_vec_add(direction, qm_vec_cross(match->along[0][i], match->along[1][i]));
    double length = qm_vec_norm(direction);
    if (!(length > QM_MIN_LENGTH)) {
        direction = qm_vec_add(qm_vec_add(match->difference[0], match->difference[1]), match->difference[2]);
        length = qm_vec_norm(direction);
    }
    return length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, direction) : (qm_vec){0, 0, 1};
}

/** The coefficients of a cubic function over a piece belong to these corners. */
static const int corners_of[10][3] = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {0, 0, 1}, {0, 1, 1},
                                      {1, 1, 2}, {1, 2, 2}, {2, 2, 0}, {2, 0, 0}, {0, 1, 2}};
/** The index of the coefficient of a quadratic function that belongs to two corners. */
static const int pair_index[3][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}};

/** The heights along one vector. */
static void set_fixed_heights(const qm_deviation_setup *setup, qm_deviation_match *match)
{
    double *height = match->height, beside = 0.0;
    match->along_normals = false;
    match->off = match->cubic_most = 0.0;
    for (int k = 0; k < 6; k++) {
        height[k] = qm_vec_dot(match->normal, match->difference[k]);
        beside = qm_max(beside, qm_vec_norm(qm_vec_axpy(match->difference[k], -height[k], match->normal)));
    }
    match->beside = (beside + setup->eta) * RELATIVE;
}

/** N, L, and the bounds of |N| over the piece. */
typedef struct normals {
    qm_vec at[3];       /* N at the corners, */
    double length[3];   /* and L */
    double least, most; /* of |N| */
    double turned;      /* by how much L may differ from |N| */
    double error;       /* of N */
} normals;

static bool make_normals(const qm_deviation_setup *setup, const qm_deviation_match *match, normals *out)
{
    double turned = 0.0;
    out->least = INFINITY;
    out->most = out->error = 0.0;
    for (int i = 0; i < 3; i++) {
        qm_vec along_s = match->along[0][i], along_t = match->along[1][i];
        out->at[i] = qm_vec_cross(along_s, along_t);
        out->length[i] = qm_vec_norm(out->at[i]);
        double up = qm_vec_dot(out->at[i], match->normal);
        turned = qm_max(turned, out->length[i] - up);
        out->least = qm_min(out->least, up);
        out->most = qm_max(out->most, out->length[i]);
        out->error = qm_max(out->error, setup->eta * (qm_vec_norm(along_s) + qm_vec_norm(along_t)));
    }
    out->least = (out->least - out->error) / RELATIVE;
    for (int i = 0; i < 3; i++)
        out->length[i] -= 0.5 * turned;
    out->turned = 0.5 * turned + out->error;
    return out->least > LEAST_NORMAL * out->most;
}

/** The heights along the normals: H, and G = N.D - H L. */
static void fit_heights(const normals *n, qm_deviation_match *match)
{
    double product[10], *height = match->height; /* product: coefficients of N.D */
    for (int c = 0; c < 10; c++) {
        product[c] = 0.0;
        for (int i = 0; i < 3; i++) {
            const int *at = corners_of[c];
            qm_vec difference = match->difference[pair_index[at[(i + 1) % 3]][at[(i + 2) % 3]]];
            product[c] += qm_vec_dot(n->at[at[i]], difference) / 3.0;
        }
    }
    for (int i = 0; i < 3; i++)
        height[i] = product[i] / n->length[i];
    for (int k = 0; k < 3; k++) {
        int j = (k + 1) % 3;
        double here = height[k] * n->length[j], there = height[j] * n->length[k];
        double sum = n->length[k] + n->length[j];
        /* This makes the coefficients of l_k^2 l_j and l_k l_j^2 opposite numbers. */
        height[3 + k] = 0.5 * (3.0 * (product[3 + 2 * k] + product[4 + 2 * k]) - here - there) / sum;
        match->cubic[k] = product[3 + 2 * k] - (here + 2.0 * height[3 + k] * n->length[k]) / 3.0;
    }
    double middle = height[3] * n->length[2] + height[4] * n->length[0] + height[5] * n->length[1];
    match->cubic[3] = product[9] - middle / 3.0;
}

/** The step z from the parameters to about the foot of a point between two corners: coefficient 3 + k. */
static void find_step_between(const qm_deviation_match *match, int k, double step[2])
{
    int j = (k + 1) % 3;
    const qm_vec *d = match->difference;
    qm_vec along_s = qm_vec_scale(0.5, qm_vec_add(match->along[0][k], match->along[0][j]));
    qm_vec along_t = qm_vec_scale(0.5, qm_vec_add(match->along[1][k], match->along[1][j]));
    qm_vec to = qm_vec_axpy(d[3 + k], 0.5, qm_vec_add(d[k], d[j]));
    double ss = qm_vec_norm2(along_s), tt = qm_vec_norm2(along_t), st = qm_vec_dot(along_s, along_t);
    double fs = qm_vec_dot(to, along_s), ft = qm_vec_dot(to, along_t), determinant = ss * tt - st * st;
    step[0] = (tt * fs - st * ft) / determinant;
    step[1] = (ss * ft - st * fs) / determinant;
    if (!(fabs(step[0]) <= 1.0 && fabs(step[1]) <= 1.0)) step[0] = step[1] = 0.0;
}

/** J z for the J of a corner and a coefficient of z. */
static qm_vec along_step(const qm_deviation_match *match, int corner, int k)
{
    return qm_vec_add(qm_vec_scale(match->step[k][0], match->along[0][corner]),
                      qm_vec_scale(match->step[k][1], match->along[1][corner]));
}

/** The greatest length of D - J z - q N, and the greatest |q|. */
static double find_rest(const qm_deviation_match *match, const normals *n, double *most_q)
{
    const double *k = match->height;
    const qm_vec *d = match->difference;
    double q[6], most = 0.0;
    for (int i = 0; i < 3; i++)
        q[i] = k[i] / n->length[i];
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3;
        double known = q[i] * n->length[j] + q[j] * n->length[i];
        q[3 + i] = 0.5 * (k[i] + k[j] + 4.0 * k[3 + i] - known) / (n->length[i] + n->length[j]);
    }
    qm_vec middle = {0, 0, 0};
    *most_q = 0.0;
    for (int i = 0; i < 3; i++) {
        const int ends[2] = {i, (i + 1) % 3};
        int other = (i + 2) % 3;
        *most_q = qm_max(*most_q, qm_max(fabs(q[i]), fabs(q[3 + i])));
        most = qm_max(most, qm_vec_norm(qm_vec_axpy(d[i], -q[i], n->at[i])));
        for (int end = 0; end < 2; end++) {
            int here = ends[end], there = ends[1 - end];
            qm_vec thrice = qm_vec_sub(d[3 + i], along_step(match, here, i));
            thrice = qm_vec_axpy(d[here], 2.0, thrice);
            thrice = qm_vec_axpy(thrice, -q[here], n->at[there]);
            thrice = qm_vec_axpy(thrice, -2.0 * q[3 + i], n->at[here]);
            most = qm_max(most, qm_vec_norm(thrice) / 3.0);
        }
        middle = qm_vec_add(middle, qm_vec_sub(d[3 + i], along_step(match, other, i)));
        middle = qm_vec_axpy(middle, -q[3 + i], n->at[other]);
    }
    return qm_max(most, qm_vec_norm(middle) / 3.0);
}

/** The greatest component of w along a normal. */
static double find_normal_w(const qm_deviation_setup *setup, const qm_bilinear *q, const normals *n)
{
    double e1 = qm_vec_norm(q->e1), e2 = qm_vec_norm(q->e2), w = qm_vec_norm(q->w);
    double volume = fabs(qm_vec_dot(qm_vec_cross(q->e1, q->e2), q->w));
    return (volume + setup->eta * (e1 * e2 + w * (e1 + e2))) / n->least * RELATIVE;
}

/** The heights along the patch's own normals; false where these turn too much. */
static bool set_normal_heights(const qm_deviation_setup *setup, qm_deviation_match *match)
{
    normals n;
    if (match->is_clamped || !make_normals(setup, match, &n)) return false;
    match->along_normals = true;
    fit_heights(&n, match);
    double most = 0.0, most_q, longest = 0.0, length = 0.5 * (n.least + n.most);
    for (int k = 0; k < 4; k++)
        match->cubic[k] /= length;
    for (int k = 0; k < 3; k++) {
        find_step_between(match, k, match->step[k]);
        longest = qm_max(longest, fabs(match->step[k][0]) + fabs(match->step[k][1]));
        for (int axis = 0; axis < 2; axis++)
            match->foot[3 + k][axis] += match->step[k][axis];
    }
    for (int k = 0; k < 6; k++)
        most = qm_max(most, fabs(match->height[k]));
    double rest = find_rest(match, &n, &most_q);
    double rounding = n.error * match->greatest + setup->eta * n.most;
    match->cubic_most = qm_quadratic_cubic_most(match->cubic) * RELATIVE;
    double uneven = 0.5 * match->cubic_most * (n.most - n.least);
    match->off = match->cubic_most + (uneven + most * n.turned + rounding) / n.least * RELATIVE;
    match->beside = (rest + n.error * most_q + 2.0 * setup->eta * (1.0 + longest)) * RELATIVE;
    match->normal_w = find_normal_w(setup, match->patch, &n);
    return true;
}

static void set_heights(const qm_deviation_setup *setup, qm_deviation_match *match)
{
    match->normal = find_direction(match);
    match->greatest = 0.0;
    for (int k = 0; k < 6; k++)
        match->greatest = qm_max(match->greatest, qm_vec_norm(match->difference[k]));
    for (int k = 0; k < 6; k++)
        for (int axis = 0; axis < 2; axis++)
            match->foot[k][axis] = 0.5 * (match->at[pair_of[k][0]][axis] + match->at[pair_of[k][1]][axis]);
    if (!set_normal_heights(setup, match)) set_fixed_heights(setup, match);
    qm_quadratic_open(match->height, match->low, match->high);
    for (int i = 0; i < 3; i++) {
        match->low[i] -= match->slack + match->off;
        match->high[i] += match->slack + match->off;
    }
    double low = qm_min(match->low[0], qm_min(match->low[1], match->low[2]));
    double high = qm_max(match->high[0], qm_max(match->high[1], match->high[2]));
    match->least = qm_max(0.0, qm_max(low, -high) - setup->eta);
    double beside = match->beside;
    match->over = beside < 2.0 * match->least ? 0.5 * beside * beside / match->least : beside;
    match->over *= RELATIVE;
}

/** The coefficient of F for a parameter at three corners, which may be the same. */
static double slope_at(const qm_deviation_match *match, int axis, int i, int j, int k)
{
    const qm_vec *along = match->along[axis], *difference = match->difference;
    return (qm_vec_dot(difference[pair_index[i][j]], along[k]) +
            qm_vec_dot(difference[pair_index[j][k]], along[i]) +
            qm_vec_dot(difference[pair_index[i][k]], along[j])) /
           3.0;
}

static void set_slopes(qm_deviation_match *match)
{
    for (int c = 0; c < 10; c++)
        for (int axis = 0; axis < 2; axis++)
            match->slope[c][axis] =
                slope_at(match, axis, corners_of[c][0], corners_of[c][1], corners_of[c][2]);
}

/** Sets the members of a match that follow from its parameters. */
static void finish(const qm_deviation_setup *setup, const qm_vec corner[6], qm_deviation_match *match)
{
    const qm_bilinear *patch = match->patch;
    double farthest = 0.0;
    for (int i = 0; i < 3; i++) {
        match->along[0][i] = qm_vec_axpy(patch->e1, match->at[i][1], patch->w);
        match->along[1][i] = qm_vec_axpy(patch->e2, match->at[i][0], patch->w);
    }
    for (int k = 0; k < 6; k++) {
        qm_vec there = qm_bilinear_polar(patch, match->at[pair_of[k][0]], match->at[pair_of[k][1]]);
        match->difference[k] = qm_vec_sub(corner[k], there);
        farthest = qm_max(farthest, qm_vec_norm2(match->difference[k]));
    }
    match->holds = farthest <= FARTHEST * FARTHEST * setup->extent * setup->extent;
    if (!match->holds) return;
    set_heights(setup, match);
    if (!match->along_normals) set_slopes(match);
}

void qm_deviation_match_make(const qm_deviation_setup *setup, const qm_deviation_face *face,
                             const qm_deviation_piece *piece, const qm_bilinear *patch, const double start[2],
                             bool within, qm_deviation_match *match)
{
    qm_vec corner[6], sum = {0, 0, 0};
    double centre[2] = {start[0], start[1]};
    match->patch = patch;
    match->slack = face->slack;
    match->is_clamped = false;
    qm_deviation_piece_coefficients(face, piece, corner);
    for (int i = 0; i < 3; i++)
        sum = qm_vec_axpy(sum, 1.0 / 3.0, corner[i]);
    qm_deviation_match_foot(patch, sum, within, centre);
    for (int i = 0; i < 3; i++) {
        double *at = match->at[i];
        at[0] = centre[0];
        at[1] = centre[1];
        qm_deviation_match_foot(patch, corner[i], within, at);
        match->is_clamped |= within && (at[0] <= 0.0 || at[0] >= 1.0 || at[1] <= 0.0 || at[1] >= 1.0);
    }
    finish(setup, corner, match);
}

/* ---- the same parameters of two patches ---- */

/** The parameters of a patch that go with those of another one when it is laid out in one of eight ways. */
static void lay_out(int layout, double s, double t, double at[2])
{
    at[layout & 1] = layout & 2 ? 1.0 - s : s;
    at[1 - (layout & 1)] = layout & 4 ? 1.0 - t : t;
}

/** The corner of a patch, (0, 0), (1, 0), (0, 1) or (1, 1). */
static qm_vec corner_at(const qm_bilinear *patch, int corner)
{
    return qm_bilinear_at(patch, corner & 1 ? 1.0 : 0.0, corner & 2 ? 1.0 : 0.0);
}

/** The layout in which the corners of both patches are nearest to one another. */
static int find_layout(const qm_bilinear *source, const qm_bilinear *target)
{
    int best = 0;
    double least = INFINITY, apart2[4][4];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            apart2[i][k] = qm_vec_norm2(qm_vec_sub(corner_at(source, i), corner_at(target, k)));
    for (int layout = 0; layout < 8; layout++) {
        double sum = 0.0;
        for (int i = 0; i < 4; i++) {
            double at[2];
            lay_out(layout, i & 1 ? 1.0 : 0.0, i & 2 ? 1.0 : 0.0, at);
            sum += apart2[i][(at[0] > 0.5 ? 1 : 0) + (at[1] > 0.5 ? 2 : 0)];
        }
        if (!(sum < least)) continue;
        least = sum;
        best = layout;
    }
    return best;
}

bool qm_deviation_match_aligned_upper(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                      const qm_deviation_piece *piece, const qm_bilinear *patch,
                                      double enough, double high[3])
{
    qm_vec corner[6];
    double at[3][2], length[6], low[3], sum = 0.0, farthest = 0.0;
    int layout = find_layout(&face->patch, patch);
    qm_deviation_piece_coefficients(face, piece, corner);
    for (int k = 0; k < 6; k++) {
        int i = pair_of[k][0], j = pair_of[k][1];
        if (k < 3) lay_out(layout, piece->u[k], piece->v[k], at[k]);
        double apart = qm_vec_distance(corner[k], qm_bilinear_polar(patch, at[i], at[j]));
        farthest = qm_max(farthest, apart);
        length[k] = apart + face->slack;
        if (k < 3) sum += length[k];
        /* A linear function above the length is no less at the corners. */
        if (k == 2 && !(sum < enough)) return false;
    }
    if (!(farthest <= FARTHEST * setup->extent)) return false;
    qm_quadratic_open(length, low, high);
    return true;
}

/* ---- the lower bound ---- */

/** The terms of the lower bound of a match that depend on the rectangle round all parameters. */
typedef struct frame {
    double upper[3]; /* M: rows (0 1), (. 2) */
    double least;    /* a */
    double reach[2]; /* |z_i| is at most this times y */
    double product;  /* and 2 |z_1 z_2| this times y^2 */
    double turn;     /* r */
} frame;

/** The frame of a box round all parameters of a match, and round another box unless that is NULL. */
static bool make_frame(const qm_deviation_setup *setup, const qm_deviation_match *match, const qm_uv_box *box,
                       frame *out)
{
    double centre[2], half[2];
    for (int k = 0; k < 2; k++) {
        double low = box ? box->low[k] : INFINITY, high = box ? box->high[k] : -INFINITY;
        for (int i = 0; i < 6; i++) {
            low = qm_min(low, match->foot[i][k]);
            high = qm_max(high, match->foot[i][k]);
        }
        centre[k] = 0.5 * (low + high);
        half[k] = 0.5 * (high - low);
    }
    qm_vec along_s = qm_vec_axpy(match->patch->e1, centre[1], match->patch->w);
    qm_vec along_t = qm_vec_axpy(match->patch->e2, centre[0], match->patch->w);
    double length = qm_vec_norm(along_s);
    if (!(length > 0.0)) return false;
    double skew = qm_vec_dot(along_s, along_t) / length;
    double across = qm_vec_norm(qm_vec_axpy(along_t, -skew / length, along_s));
    double other = sqrt(skew * skew + across * across), most = sqrt(length * length + other * other);
    double determinant = length * across / RELATIVE;
    out->least = determinant / most;
    if (!(out->least > LEAST_SINE * most)) return false;
    out->upper[0] = length;
    out->upper[1] = skew;
    out->upper[2] = across;
    out->reach[0] = other / determinant * RELATIVE;
    out->reach[1] = length / determinant * RELATIVE;
    out->product = length * (other + fabs(skew)) / (determinant * determinant) * RELATIVE;
    double widths = half[0] * out->reach[1] + half[1] * out->reach[0];
    out->turn = qm_vec_norm(match->patch->w) * widths * RELATIVE + setup->eta / out->least;
    return out->turn < 1.0;
}

/** On which edge of the square all parameters are, and the difference points away: 1 or -1 for the side, else
 * 0. */
static int wall_of(const qm_deviation_match *match, int axis)
{
    bool is_high = true, is_low = true;
    for (int i = 0; i < 3; i++) {
        is_high &= match->at[i][axis] >= 1.0;
        is_low &= match->at[i][axis] <= 0.0;
    }
    return is_high ? 1 : is_low ? -1 : 0;
}

/** f: the greatest length of M^-T F. */
static double find_slope(const qm_deviation_setup *setup, const qm_deviation_match *match, const frame *at)
{
    const int wall[2] = {wall_of(match, 0), wall_of(match, 1)};
    double most2 = 0.0, part[2] = {0.0, 0.0}, longest = 0.0;
    double inverse = 1.0 / at->upper[0], across = 1.0 / at->upper[2];
    for (int c = 0; c < 10; c++) {
        const double *f = match->slope[c];
        double first = f[0] * inverse, second = (f[1] - at->upper[1] * first) * across;
        most2 = qm_max(most2, first * first + second * second);
        for (int axis = 0; axis < 2; axis++) {
            double inwards = wall[axis] > 0 ? -f[axis] : wall[axis] < 0 ? f[axis] : fabs(f[axis]);
            part[axis] = qm_max(part[axis], inwards);
        }
    }
    for (int i = 0; i < 3; i++)
        longest = qm_max(longest, qm_vec_norm(match->along[0][i]) + qm_vec_norm(match->along[1][i]));
    double most = sqrt(most2), by_walls = part[0] * at->reach[0] + part[1] * at->reach[1];
    double rounding = setup->eta * (longest + match->greatest) + 0x1p-40 * match->greatest * longest;
    if ((wall[0] || wall[1]) && by_walls < most) most = by_walls;
    return (most + rounding / at->least) * RELATIVE;
}

/** y: the greatest length of J0 z. */
static double find_longest_step(const qm_deviation_match *match, const frame *at)
{
    double most2 = 0.0;
    for (int k = 0; k < 3; k++) {
        double first = at->upper[0] * match->step[k][0] + at->upper[1] * match->step[k][1];
        double second = at->upper[2] * match->step[k][1];
        most2 = qm_max(most2, first * first + second * second);
    }
    return MOST_PAIRS * sqrt(most2) * RELATIVE;
}

/** The terms of heights along the normals. */
typedef struct normal_terms {
    double step;     /* y */
    double straight; /* 1 - r */
    double w, bent;  /* |w| k / 2, and omega k */
    double lift;     /* omega k y^2 / 2 */
    double e;
} normal_terms;

static normal_terms find_normal_terms(const qm_deviation_match *match, const frame *at)
{
    double step = find_longest_step(match, at), k = at->product;
    double w = 0.5 * k * qm_vec_norm(match->patch->w), bent = match->normal_w * k;
    return (normal_terms){.step = step,
                          .straight = 1.0 - at->turn,
                          .w = w,
                          .bent = bent,
                          .lift = 0.5 * bent * step * step,
                          .e = match->beside + w * step * step};
}

qm_match_rise qm_deviation_match_rise(const qm_deviation_setup *setup, const qm_deviation_match *match)
{
    frame at;
    qm_match_rise rise = {INFINITY, {FOOT_ROUNDING, FOOT_ROUNDING}};
    if (!match->holds) return rise;
    if (!match->along_normals) {
        rise.over = match->over;
        return rise;
    }
    if (!make_frame(setup, match, NULL, &at)) return rise;
    normal_terms t = find_normal_terms(match, &at);
    double upright = t.straight - t.bent * t.step, last = t.e / upright;
    if (!(upright > CLEAR)) return rise;
    rise.over = (t.lift + t.bent * t.step * last + t.w * last * last) * RELATIVE;
    for (int i = 0; i < 2; i++)
        rise.foot[i] += last * at.reach[i] * RELATIVE;
    return rise;
}

double qm_deviation_match_plane_loss(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                     const qm_vec bezier[6])
{
    const qm_uv_box whole = {{0.0, 0.0}, {1.0, 1.0}};
    qm_vec corner[4], normal = qm_vec_scale(1.0 / RELATIVE, match->normal);
    double low = INFINITY, high = -INFINITY, most[2] = {0.0, 0.0};
    qm_uv_box_corners(match->patch, &whole, corner);
    for (int i = 0; i < 4; i++) {
        double here = qm_vec_dot(normal, qm_vec_sub(corner[i], corner[0]));
        low = qm_min(low, here);
        high = qm_max(high, here);
    }
    for (int k = 0; k < 6; k++) {
        double plane = qm_vec_dot(normal, qm_vec_sub(bezier[k], corner[0])) - 0.5 * (low + high);
        most[0] = qm_max(most[0], fabs(match->height[k] - plane));
        most[1] = qm_max(most[1], fabs(match->height[k] + plane));
    }
    return (qm_min(most[0], most[1]) + 0.5 * (high - low) + match->cubic_most + setup->eta) * RELATIVE;
}

/** The margin of heights along the normals. */
static void set_normal_margin(const qm_deviation_setup *setup, const qm_deviation_match *match,
                              const frame *at, qm_match_margin *margin)
{
    normal_terms t = find_normal_terms(match, at);
    double step = t.step, straight = t.straight, bent = t.bent, lift = t.lift, e = t.e, height = 0.0;
    for (int i = 0; i < 6; i++)
        height = qm_max(height, fabs(match->height[i]));
    height += match->off + lift + setup->eta;
    double left = straight * straight - height * bent * RELATIVE;
    if (!(left > CLEAR)) return;
    double root = sqrt(left), a = bent * step / straight;
    double lost = 2.0 * e * a + height * a * a + e * e * bent / (straight * straight);
    margin->loss = (lift + lost * straight * straight / left) * RELATIVE;
    for (int i = 0; i < 2; i++)
        margin->stretch[i] = root / RELATIVE / at->reach[i];
    margin->offset = (e + height * a) * straight / root * RELATIVE;
}

/** The margin of heights along one vector. */
static void set_fixed_margin(const qm_deviation_setup *setup, const qm_deviation_match *match,
                             const frame *at, qm_match_margin *margin)
{
    double bent = 0.0;
    for (int k = 0; k < 6; k++)
        bent = qm_max(bent, fabs(qm_vec_dot(match->difference[k], match->patch->w)));
    bent += setup->eta * (qm_vec_norm(match->patch->w) + match->greatest);
    double left = (1.0 - at->turn) * (1.0 - at->turn) - bent * at->product * RELATIVE;
    if (!(left > CLEAR)) return;
    double root = sqrt(left), f = find_slope(setup, match, at);
    margin->loss = f / root;
    if (match->least > 0.0) margin->loss = qm_min(margin->loss, f * f / (left * match->least));
    margin->loss *= RELATIVE;
    for (int k = 0; k < 2; k++)
        margin->stretch[k] = root / RELATIVE / at->reach[k];
    margin->offset = f / root * RELATIVE;
}

qm_match_margin qm_deviation_match_margin(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                          const qm_uv_box *box)
{
    frame at;
    qm_match_margin margin = {INFINITY, {0.0, 0.0}, 0.0};
    if (!match->holds || !make_frame(setup, match, box, &at)) return margin;
    if (match->along_normals)
        set_normal_margin(setup, match, &at, &margin);
    else
        set_fixed_margin(setup, match, &at, &margin);
    for (int k = 0; k < 2; k++)
        margin.offset += FOOT_ROUNDING * margin.stretch[k];
    return margin;
}

void qm_deviation_match_beyond(const qm_deviation_match *match, const qm_uv_box *box,
                               const qm_match_margin *margin, double beyond[6])
{
    double most = -INFINITY;
    for (int k = 0; k < 4; k++) {
        double by[6];
        for (int i = 0; i < 6; i++) {
            double at = match->foot[i][k / 2];
            by[i] = margin->stretch[k / 2] * (k % 2 ? at - box->high[k / 2] : box->low[k / 2] - at) -
                    margin->offset;
        }
        if (!(by[0] + by[1] + by[2] > most)) continue;
        most = by[0] + by[1] + by[2];
        for (int i = 0; i < 6; i++)
            beyond[i] = by[i];
    }
}

void qm_deviation_match_beside(const qm_deviation_face *face, const qm_deviation_piece *piece,
                               const qm_bilinear *patch, const qm_uv_box *box, qm_vec normal,
                               double height[4][3])
{
    qm_vec corner[4], at[6];
    qm_uv_box_corners(patch, box, corner);
    qm_deviation_piece_coefficients(face, piece, at);
    for (int edge = 0; edge < 4; edge++) {
        qm_vec outwards = qm_vec_cross(qm_vec_sub(corner[(edge + 1) % 4], corner[edge]), normal);
        qm_vec inwards = qm_vec_sub(corner[(edge + 2) % 4], corner[edge]);
        double length = qm_vec_norm(outwards), side = qm_vec_dot(inwards, outwards) > 0.0 ? -1.0 : 1.0;
        double value[6], farthest = -INFINITY;
        /* Any vector that is not longer than 1 will do. */
        outwards =
            length > QM_MIN_LENGTH ? qm_vec_scale(side / (length * RELATIVE), outwards) : (qm_vec){0, 0, 0};
        for (int i = 0; i < 4; i++)
            farthest = qm_max(farthest, qm_vec_dot(outwards, corner[i]));
        for (int k = 0; k < 6; k++)
            value[k] = farthest - qm_vec_dot(outwards, at[k]);
        qm_quadratic_raise(value, height[edge]);
        for (int i = 0; i < 3; i++)
            height[edge][i] = -height[edge][i];
    }
}

/* ---- the upper bounds ---- */

void qm_deviation_match_upper(const qm_deviation_match *match, double high[3])
{
    double length[6], low[3];
    for (int k = 0; k < 6; k++)
        length[k] = qm_vec_norm(match->difference[k]) + match->slack;
    qm_quadratic_open(length, low, high);
}

void qm_deviation_match_edges(const qm_deviation_setup *setup, const qm_deviation_match *match,
                              const double foot[2], double beyond[4][3])
{
    for (int axis = 0; axis < 2; axis++) {
        qm_vec edge = axis ? match->patch->e2 : match->patch->e1;
        double speed = 0.0, value[2][6];
        for (int i = 0; i < 6; i++) {
            double other = match->foot[i][1 - axis], at = match->foot[i][axis];
            speed = qm_max(speed, qm_vec_norm(qm_vec_axpy(edge, other, match->patch->w)));
            speed = qm_max(speed, qm_vec_norm(qm_vec_axpy(edge, qm_clamp(other, 0.0, 1.0), match->patch->w)));
            value[0][i] = foot[axis] - at;
            value[1][i] = foot[axis] + at - 1.0;
        }
        speed = (speed + foot[1 - axis] * qm_vec_norm(match->patch->w) + setup->eta) * RELATIVE;
        for (int side = 0; side < 2; side++) {
            qm_quadratic_raise(value[side], beyond[2 * axis + side]);
            for (int i = 0; i < 3; i++)
                beyond[2 * axis + side][i] *= speed;
        }
    }
}
