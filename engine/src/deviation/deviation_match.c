/**
 * deviation_match.c: finds the parameters of a match by a few Newton steps, then bounds its coefficients. The
 * parameters need not be footpoints: any affine map is valid, and the bounds are as good as it is near.
 */
#include "deviation_match.h"

#include "core/rounding.h"

#define STEPS 8                  /* of Newton's method for one foot */
#define BEYOND 0.5               /* of the parameters: how far a match may leave the unit square */
#define CLOSE_STEP 0x1p-30       /* a step that is shorter is the last one */
#define CLEAR 0.125              /* least m that is worth a bound */
#define LEAST_SINE 0x1p-10       /* of a frame: between a and the length of its columns */
#define RELATIVE (1.0 + 0x1p-40) /* for the roundings of a few dozen operations on positive terms */
#define MOST_SLOPE 0.25          /* of a graph: steeper ones give poor bounds */
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

static void set_heights(const qm_deviation_setup *setup, qm_deviation_match *match)
{
    qm_vec n = find_direction(match);
    double *height = match->height, beside = 0.0;
    match->normal = n;
    match->greatest = 0.0;
    for (int k = 0; k < 6; k++) {
        height[k] = qm_vec_dot(n, match->difference[k]);
        beside = qm_max(beside, qm_vec_norm(qm_vec_axpy(match->difference[k], -height[k], n)));
        match->greatest = qm_max(match->greatest, qm_vec_norm(match->difference[k]));
    }
    qm_quadratic_open(height, match->low, match->high);
    for (int i = 0; i < 3; i++) {
        match->low[i] -= match->slack;
        match->high[i] += match->slack;
    }
    double low = qm_min(match->low[0], qm_min(match->low[1], match->low[2]));
    double high = qm_max(match->high[0], qm_max(match->high[1], match->high[2]));
    match->least = qm_max(0.0, qm_max(low, -high) - setup->eta);
    beside = (beside + setup->eta) * RELATIVE;
    match->beside = beside;
    match->over = beside < 2.0 * match->least ? 0.5 * beside * beside / match->least : beside;
    match->over *= RELATIVE;
}

/** The coefficient of F for a parameter at three corners, which may be the same. */
static double slope_at(const qm_deviation_match *match, int axis, int i, int j, int k)
{
    static const int index[3][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}};
    const qm_vec *along = match->along[axis], *difference = match->difference;
    return (qm_vec_dot(difference[index[i][j]], along[k]) + qm_vec_dot(difference[index[j][k]], along[i]) +
            qm_vec_dot(difference[index[i][k]], along[j])) /
           3.0;
}

static void set_slopes(qm_deviation_match *match)
{
    static const int corners[10][3] = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {0, 0, 1}, {0, 1, 1},
                                       {1, 1, 2}, {1, 2, 2}, {0, 2, 2}, {0, 0, 2}, {0, 1, 2}};
    for (int c = 0; c < 10; c++)
        for (int axis = 0; axis < 2; axis++)
            match->slope[c][axis] = slope_at(match, axis, corners[c][0], corners[c][1], corners[c][2]);
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
    set_slopes(match);
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

/** The parameters of a patch that go with those of another one when it is laid out in one of eight ways. */
static void lay_out(int layout, double s, double t, double at[2])
{
    at[layout & 1] = layout & 2 ? 1.0 - s : s;
    at[1 - (layout & 1)] = layout & 4 ? 1.0 - t : t;
}

static int find_layout(const qm_bilinear *source, const qm_bilinear *target)
{
    int best = 0;
    double least = INFINITY;
    for (int layout = 0; layout < 8; layout++) {
        double sum = 0.0;
        for (int i = 0; i < 4; i++) {
            double s = i & 1 ? 1.0 : 0.0, t = i & 2 ? 1.0 : 0.0, at[2];
            lay_out(layout, s, t, at);
            sum +=
                qm_vec_norm2(qm_vec_sub(qm_bilinear_at(source, s, t), qm_bilinear_at(target, at[0], at[1])));
        }
        if (!(sum < least)) continue;
        least = sum;
        best = layout;
    }
    return best;
}

void qm_deviation_match_aligned(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                const qm_deviation_piece *piece, const qm_bilinear *patch,
                                qm_deviation_match *match)
{
    qm_vec corner[6];
    int layout = find_layout(&face->patch, patch);
    match->patch = patch;
    match->slack = face->slack;
    match->is_clamped = false;
    qm_deviation_piece_coefficients(face, piece, corner);
    for (int i = 0; i < 3; i++)
        lay_out(layout, piece->u[i], piece->v[i], match->at[i]);
    finish(setup, corner, match);
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

static bool make_frame(const qm_deviation_setup *setup, const qm_deviation_match *match, const qm_uv_box *box,
                       frame *out)
{
    double centre[2], half[2];
    for (int k = 0; k < 2; k++) {
        double low = box->low[k], high = box->high[k];
        for (int i = 0; i < 3; i++) {
            low = qm_min(low, match->at[i][k]);
            high = qm_max(high, match->at[i][k]);
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

/** The box U' of deviation_match.h, as far as it can lie within the rectangle or at the match. */
static qm_uv_box find_view(const qm_deviation_match *match, const qm_uv_box *box, const frame *at)
{
    qm_uv_box view;
    for (int k = 0; k < 2; k++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < 3; i++) {
            low = qm_min(low, match->at[i][k]);
            high = qm_max(high, match->at[i][k]);
        }
        double way = 2.0 * match->greatest / (1.0 - at->turn) * at->reach[k] * RELATIVE;
        view.low[k] = qm_max(low - way, qm_min(low, box->low[k]));
        view.high[k] = qm_min(high + way, qm_max(high, box->high[k]));
    }
    return view;
}

/** The slope of a patch over the plane normal to n; INFINITY where it is no graph over that plane. */
static double find_graph_slope(const qm_deviation_setup *setup, const qm_deviation_match *match,
                               const qm_uv_box *view)
{
    double least = INFINITY, most = 0.0;
    for (int i = 0; i < 4; i++) {
        qm_vec along_s = qm_vec_axpy(match->patch->e1, i & 1 ? view->high[1] : view->low[1], match->patch->w);
        qm_vec along_t = qm_vec_axpy(match->patch->e2, i & 2 ? view->high[0] : view->low[0], match->patch->w);
        qm_vec normal = qm_vec_cross(along_s, along_t);
        double up = qm_vec_dot(normal, match->normal);
        double error = setup->eta * (qm_vec_norm(along_s) + qm_vec_norm(along_t));
        least = qm_min(least, up - error);
        most = qm_max(most, qm_vec_norm(qm_vec_axpy(normal, -up, match->normal)) + error);
    }
    return least > 0.0 ? most / least * RELATIVE : INFINITY;
}

static qm_match_graph find_graph(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                 const qm_uv_box *box, const frame *at)
{
    qm_match_graph graph = {.view = find_view(match, box, at)};
    graph.slope = find_graph_slope(setup, match, &graph.view);
    graph.holds = graph.slope <= MOST_SLOPE;
    if (!graph.holds) return graph;
    graph.over = graph.slope * match->beside * RELATIVE;
    graph.loss = (graph.over + 0.5 * graph.slope * graph.slope * match->greatest) * RELATIVE;
    for (int k = 0; k < 2; k++) {
        graph.view.low[k] = qm_max(0.0, graph.view.low[k]);
        graph.view.high[k] = qm_min(1.0, graph.view.high[k]);
    }
    return graph;
}

qm_match_graph qm_deviation_match_graph(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                        const qm_uv_box *box)
{
    frame at;
    if (!match->holds || !make_frame(setup, match, box, &at)) return (qm_match_graph){.holds = false};
    return find_graph(setup, match, box, &at);
}

qm_match_margin qm_deviation_match_margin(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                          const qm_uv_box *box)
{
    frame at;
    double bent = 0.0;
    qm_match_margin margin = {INFINITY, INFINITY, {0.0, 0.0}, 0.0};
    if (!match->holds || !make_frame(setup, match, box, &at)) return margin;
    qm_match_graph graph = find_graph(setup, match, box, &at);
    if (graph.holds) margin.loss = graph.loss;
    for (int k = 0; k < 6; k++)
        bent = qm_max(bent, fabs(qm_vec_dot(match->difference[k], match->patch->w)));
    bent += setup->eta * (qm_vec_norm(match->patch->w) + match->greatest);
    double left = (1.0 - at.turn) * (1.0 - at.turn) - bent * at.product * RELATIVE;
    if (!(left > CLEAR)) return margin;
    double root = sqrt(left), f = find_slope(setup, match, &at), loss = f / root;
    if (match->least > 0.0) loss = qm_min(loss, f * f / (left * match->least));
    margin.tilted = loss * RELATIVE;
    margin.loss = qm_min(margin.loss, margin.tilted);
    for (int k = 0; k < 2; k++)
        margin.stretch[k] = root / RELATIVE / at.reach[k];
    margin.offset = f / root * RELATIVE;
    return margin;
}

void qm_deviation_match_beyond(const qm_deviation_match *match, const qm_uv_box *box,
                               const qm_match_margin *margin, double beyond[3])
{
    double most = -INFINITY;
    for (int k = 0; k < 4; k++) {
        double by[3];
        for (int i = 0; i < 3; i++) {
            double at = match->at[i][k / 2];
            by[i] = margin->stretch[k / 2] * (k % 2 ? at - box->high[k / 2] : box->low[k / 2] - at) -
                    margin->offset;
        }
        if (!(by[0] + by[1] + by[2] > most)) continue;
        most = by[0] + by[1] + by[2];
        for (int i = 0; i < 3; i++)
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
                              double beyond[4][3])
{
    for (int axis = 0; axis < 2; axis++) {
        qm_vec edge = axis ? match->patch->e2 : match->patch->e1;
        double speed = 0.0;
        for (int i = 0; i < 3; i++) {
            qm_vec inside = qm_vec_axpy(edge, qm_clamp(match->at[i][1 - axis], 0.0, 1.0), match->patch->w);
            speed = qm_max(speed, qm_vec_norm(match->along[axis][i]));
            speed = qm_max(speed, qm_vec_norm(inside));
        }
        speed += setup->eta;
        for (int i = 0; i < 3; i++) {
            beyond[2 * axis][i] = -match->at[i][axis] * speed * RELATIVE;
            beyond[2 * axis + 1][i] = (match->at[i][axis] - 1.0) * speed * RELATIVE;
        }
    }
}

/** The least sine of the acute angles of the quad seen along n, 1 where there is none; 0 where rounding
 * leaves open whether a corner is convex. */
static double find_least_sine(const qm_vec edge[4], double error)
{
    double least = 1.0;
    for (int k = 0; k < 4; k++) {
        qm_vec on = edge[(k + 1) % 4], back = qm_vec_scale(-1.0, edge[k]);
        double lengths = qm_vec_norm(on) * qm_vec_norm(back);
        double sine = qm_vec_norm(qm_vec_cross(on, back)) - error * (qm_vec_norm(on) + qm_vec_norm(back));
        if (!(sine > LEAST_SINE * lengths)) return 0.0;
        if (qm_vec_dot(on, back) > 0.0) least = qm_min(least, sine / lengths);
    }
    return least;
}

double qm_deviation_match_view_edges(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                     const qm_deviation_piece *piece, const qm_deviation_match *match,
                                     const qm_match_graph *graph, double beyond[4][3])
{
    qm_vec corner[4], edge[4], at[6], n = match->normal;
    qm_uv_box_corners(match->patch, &graph->view, corner);
    qm_deviation_piece_coefficients(face, piece, at);
    for (int k = 0; k < 4; k++) {
        qm_vec on = qm_vec_sub(corner[(k + 1) % 4], corner[k]);
        edge[k] = qm_vec_axpy(on, -qm_vec_dot(on, n), n);
    }
    double sine = find_least_sine(edge, setup->eta);
    if (!(sine > 0.0)) return INFINITY;
    for (int k = 0; k < 4; k++) {
        double length = qm_vec_norm(edge[k]), value[6], farthest = 0.0;
        qm_vec outwards = qm_vec_scale(1.0 / length, qm_vec_cross(edge[k], n));
        for (int i = 0; i < 6; i++) {
            qm_vec from = qm_vec_sub(at[i], corner[k]);
            value[i] = qm_vec_dot(outwards, from);
            farthest = qm_max(farthest, qm_vec_norm(from));
        }
        qm_quadratic_raise(value, beyond[k]);
        double error = setup->eta * (1.0 + farthest / length);
        for (int i = 0; i < 3; i++)
            beyond[k][i] += error;
    }
    return (1.0 + graph->slope) / sine * RELATIVE;
}
