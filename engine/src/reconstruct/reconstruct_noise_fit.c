/**
 * reconstruct_noise_fit.c: the vertices of all lattices as a least-squares fit to noisy points.
 *
 * The vertices move along their normals by d. A point with projection (u, v) in a quad has the residual r - sum B_k(u, v) d_k from
 * the plane there, B_k being the bilinear weights of the corners. What is minimised is
 *
 *     1 / m sum w_i (r_i - B_i d)^2 + lambda / A sum a_j (kappa_j + D_j d)^2
 *
 * over m points and an area A: the mean square of the residuals and lambda times that of the curvatures
 * (reconstruct_bending.c). lambda is the fourth power of the length over which noise is averaged. It minimises the mean square of the
 * error as the points themselves show it: generalised cross-validation,
 *
 *     V(lambda) = R / m / (1 - t / m)^2,
 *
 * R being the sum of the squares of the residuals and t the trace of the map from points to fitted points, the number of free
 * parameters that remain. t is the mean of z' B M^-1 B' z over random signs z (Hutchinson), M being the matrix of the normal equations;
 * one vector z, from a hash, has an error of about sqrt (2 t), that is sqrt (2 / t) of t. With a noise s that is given, what is minimised
 * is the estimate of the same error that needs it: R / m + 2 s^2 t / m (Mallows).
 *
 * There are two rounds. Points are projected onto the lattices along the lattices' normals, and those of a surface that follows the noise
 * follow it too: the residuals would be too small, and V with them. The first fit is smooth enough to have few parameters a point,
 * and the second one, whose moves start from it, has the points' projections onto that.
 *
 * Known normals give two equations more a point: each tangent of the quad there is normal to them. The sum of the squares of their
 * residuals, slopes, counts (s / s_n)^2, s_n being the standard deviation of the normals: all equations have the variance s^2 then.
 * Normals see what is short, points what is long.
 *
 * Points far off count less (Huber 1964): beyond 2.5 s their weight falls with the distance.
 *
 * Sources: P. Craven, G. Wahba, Smoothing noisy data with spline functions, 1978; M. Hutchinson, A stochastic estimator of the trace
 * of the influence matrix, 1989; C. Mallows, Some comments on Cp, 1973; M. Hestenes, E. Stiefel, Methods of conjugate gradients, 1952.
 */
#include "reconstruct_internal.h"

#include <string.h>

#include "cloud/cloud_points.h"
#include "reconstruct_bending.h"

#define SMOOTH_SHARE 0.02 /* of the equations: the free parameters of the first fit */
#define FIRST_LENGTH 0.35 /* of averaging, in mean edges */
#define LENGTH_RATIO 1.4  /* between lengths that are tried */
#define LENGTHS 16        /* at most */
#define RISES 2           /* lengths in a row that are worse than the best: the minimum is passed */
#define MIN_COSINE 0.3    /* between a point's normal and the quad's */
#define HUBER 2.5         /* standard deviations */
#define MAX_MOVE 1.0      /* of the longest edge at a vertex */
#define MIN_SINE 0.1      /* the scaled Jacobian below which no quad may come by a move */
#define OPENINGS 40       /* rounds of moving the vertices of folded quads */
#define HALVINGS 6        /* of moves that spoil a quad */
#define ITERATIONS 120    /* of conjugate gradients */
#define ACCURACY 1e-3     /* of the residual of the normal equations, by its start */

enum { POINT_SIZE = 3 * sizeof(double), BLOCK_TERMS = 10 };

/** The fit of a mesh: sums over the points of each quad, and the bending. */
typedef struct noise_fit {
    qm_context *ctx;
    qm_mesh mesh;
    qm_vec *normal;
    qm_bending bending;
    bool *is_fixed;
    double (*block)[BLOCK_TERMS]; /* of each quad: sum w B B', its lower half */
    double *right;                /* sum w B r */
    double *signs;                /* sum sqrt(w) B z */
    double residual2, weight, edge;
    size_t equations;
    double scale;                          /* of the mesh here to the surface */
    double sigma, turn;                    /* of the points, and of their normals, in radians, 0 if unknown */
    double *move, *probe;                  /* the solutions for right and for signs */
    double *rest, *way, *image, *diagonal; /* of conjugate gradients */
} noise_fit;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a fit to noisy points");
}

static void free_fit(noise_fit *f)
{
    size_t vertices = f->mesh.vertex_count, faces = f->mesh.face_count;
    double *const vectors[] = {f->right, f->signs, f->move, f->probe, f->rest, f->way, f->image, f->diagonal};
    for (size_t k = 0; k < sizeof vectors / sizeof *vectors; k++)
        qm_context_free(f->ctx, vectors[k], vertices, sizeof(double));
    qm_context_free(f->ctx, f->normal, vertices, sizeof *f->normal);
    qm_context_free(f->ctx, f->is_fixed, vertices, sizeof *f->is_fixed);
    qm_context_free(f->ctx, f->block, faces, sizeof *f->block);
    qm_bending_reset(f->ctx, &f->bending);
    qm_mesh_reset(f->ctx, &f->mesh);
}

static qm_vec vertex_at(const noise_fit *f, uint32_t vertex)
{
    return qm_vec_load(f->mesh.positions + 3 * (size_t)vertex);
}

/** Sets the normals of the vertices, means of the quads round them by area, and the mean edge. */
static void set_normals(noise_fit *f)
{
    const qm_mesh *mesh = &f->mesh;
    double sum = 0.0;
    for (size_t i = 0; i < mesh->vertex_count; i++)
        f->normal[i] = (qm_vec){0, 0, 0};
    for (size_t face = 0; face < mesh->face_count; face++) {
        const uint32_t *v = mesh->faces + 4 * face;
        qm_vec corner[4];
        for (int k = 0; k < 4; k++)
            corner[k] = qm_vec_load(mesh->positions + 3 * (size_t)v[k]);
        qm_vec area = qm_vec_cross(qm_vec_sub(corner[2], corner[0]), qm_vec_sub(corner[3], corner[1]));
        for (int k = 0; k < 4; k++) {
            f->normal[v[k]] = qm_vec_add(f->normal[v[k]], area);
            sum += qm_vec_distance(corner[k], corner[(k + 1) % 4]);
        }
    }
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        double length = qm_vec_norm(f->normal[i]);
        if (length > 0.0) f->normal[i] = qm_vec_scale(1.0 / length, f->normal[i]);
    }
    f->edge = sum / (4.0 * (double)mesh->face_count);
}

static void scale_mesh(noise_fit *f, double scale)
{
    for (size_t i = 0; i < 3 * f->mesh.vertex_count; i++)
        f->mesh.positions[i] *= scale;
}

static qm_status create_fit(qm_context *ctx, const qm_reconstruction *r, noise_fit *f)
{
    *f = (noise_fit){.ctx = ctx};
    qm_status status = qm_lattices_mesh(ctx, r, true, &f->mesh);
    if (status != QM_OK) return status;
    /* Fourth powers of lengths may overflow in the unit of the surface. A power of two changes no bit of a vertex that stays. */
    f->scale = exp2(-ilogb(r->given.diagonal));
    scale_mesh(f, f->scale);
    size_t vertices = f->mesh.vertex_count;
    double **const vectors[] = {&f->right, &f->signs, &f->move,  &f->probe,
                                &f->rest,  &f->way,   &f->image, &f->diagonal};
    bool has_memory = true;
    for (size_t k = 0; k < sizeof vectors / sizeof *vectors; k++) {
        *vectors[k] = qm_context_alloc(ctx, vertices, sizeof(double));
        has_memory &= *vectors[k] != NULL;
    }
    f->normal = qm_context_alloc(ctx, vertices, sizeof *f->normal);
    f->is_fixed = qm_context_alloc(ctx, vertices, sizeof *f->is_fixed);
    f->block = qm_context_alloc(ctx, f->mesh.face_count, sizeof *f->block);
    if (!has_memory || !f->normal || !f->is_fixed || !f->block) return no_memory(ctx);
    set_normals(f);
    return qm_bending_create(ctx, &f->mesh, f->normal, &f->bending);
}

/** 1 or -1 by a hash of a number. */
static double sign_of(size_t i)
{
    uint64_t x = ((uint64_t)i + 1) * UINT64_C(0x9e3779b97f4a7c15);
    x ^= x >> 29;
    x *= UINT64_C(0xbf58476d1ce4e5b9);
    return x >> 63 ? 1.0 : -1.0;
}

/** Adds the equation sum factor[k] d[corner[k]] = residual to the sums of a quad. Residuals beyond a limit count less. */
static void add_equation(noise_fit *f, size_t face, const double factor[4], double residual, double limit,
                         size_t number)
{
    const uint32_t *corner = f->mesh.faces + 4 * face;
    double w = fabs(residual) > limit ? limit / fabs(residual) : 1.0;
    double *block = f->block[face], z = sqrt(w) * sign_of(number);
    for (int i = 0, term = 0; i < 4; i++) {
        f->right[corner[i]] += w * factor[i] * residual;
        f->signs[corner[i]] += z * factor[i];
        for (int k = 0; k <= i; k++)
            block[term++] += w * factor[i] * factor[k];
    }
    f->residual2 += w * residual * residual;
    f->equations++;
}

/** The quad under a point: foot, tangents along rows and columns, normal, at parameters in it. */
typedef struct quad_place {
    qm_vec foot, tangent[2], normal;
    double weight[4], slope[2][4]; /* of the corners: in the foot, in the tangents */
} quad_place;

/** False where the quad has no normal. */
static bool find_place(const noise_fit *f, size_t face, double u, double v, quad_place *out)
{
    const uint32_t *corner = f->mesh.faces + 4 * face;
    *out = (quad_place){.weight = {(1.0 - u) * (1.0 - v), u * (1.0 - v), u * v, (1.0 - u) * v},
                        .slope = {{v - 1.0, 1.0 - v, v, -v}, {u - 1.0, -u, u, 1.0 - u}}};
    for (int k = 0; k < 4; k++) {
        qm_vec at = qm_vec_load(f->mesh.positions + 3 * (size_t)corner[k]);
        out->foot = qm_vec_axpy(out->foot, out->weight[k], at);
        out->normal = qm_vec_axpy(out->normal, out->weight[k], f->normal[corner[k]]);
        for (int side = 0; side < 2; side++)
            out->tangent[side] = qm_vec_axpy(out->tangent[side], out->slope[side][k], at);
    }
    double length = qm_vec_norm(out->normal);
    if (!(length > 0.0)) return false;
    out->normal = qm_vec_scale(1.0 / length, out->normal);
    return true;
}

/** Adds the equations of a point: that it lies on the quad, and, of a known normal, that both tangents are normal to it. */
static void add_point(noise_fit *f, const qm_samples *samples, size_t i, size_t face, double u, double v)
{
    quad_place place;
    if (!find_place(f, face, u, v, &place)) return;
    double away =
        qm_vec_dot(qm_vec_sub(qm_vec_scale(f->scale, qm_vec_load(samples->positions + 3 * i)), place.foot),
                   place.normal);
    add_equation(f, face, place.weight, away, HUBER * f->sigma, 3 * i);
    if (!samples->normals || !(f->turn > 0.0)) return;
    const float *row = samples->normals + 3 * i;
    qm_vec normal = {(double)row[0], (double)row[1], (double)row[2]};
    double cosine = qm_vec_dot(normal, place.normal), scale = f->sigma / f->turn;
    if (!(fabs(cosine) > MIN_COSINE * qm_vec_norm(normal))) return;
    for (int side = 0; side < 2; side++) {
        double length = qm_vec_norm(place.tangent[side]), factor[4];
        if (!(length > 0.0)) continue;
        for (int k = 0; k < 4; k++)
            factor[k] = scale * place.slope[side][k] / length;
        double rise = -scale * qm_vec_dot(place.tangent[side], normal) / (length * cosine);
        add_equation(f, face, factor, rise, HUBER * f->sigma, 3 * i + 1 + (size_t)side);
    }
}

/** Sums the points over the quads, those that are projected inside of a patch and near it. */
static void add_points(noise_fit *f, const qm_reconstruction *r, const qm_samples *samples,
                       const size_t *first)
{
    memset(f->block, 0, f->mesh.face_count * sizeof *f->block);
    memset(f->right, 0, f->mesh.vertex_count * sizeof *f->right);
    memset(f->signs, 0, f->mesh.vertex_count * sizeof *f->signs);
    f->residual2 = 0.0;
    f->equations = 0;
    double most = qm_reconstruction_cover_distance(r);
    for (size_t i = 0; i < samples->count; i++) {
        const qm_sample_location *at = &samples->location[i];
        const qm_lattice *lattice = &r->lattices[at->patch];
        if (!(at->distance <= most) || at->u <= 0.0 || at->v <= 0.0 || at->u >= lattice->columns ||
            at->v >= lattice->rows)
            continue;
        uint32_t column = (uint32_t)at->u, row = (uint32_t)at->v;
        add_point(f, samples, i, first[at->patch] + (size_t)row * lattice->columns + column, at->u - column,
                  at->v - row);
    }
}

/** out = M d: the sums of the points over their number and lambda times the bending. */
static void multiply(const noise_fit *f, double lambda, const double *d, double *out)
{
    double per_point = 1.0 / (double)f->equations, per_area = lambda / f->bending.area;
    memset(out, 0, f->mesh.vertex_count * sizeof *out);
    for (size_t face = 0; face < f->mesh.face_count; face++) {
        const uint32_t *v = f->mesh.faces + 4 * face;
        const double *block = f->block[face];
        for (int i = 0, term = 0; i < 4; i++) {
            for (int k = 0; k < i; k++, term++) {
                out[v[i]] += per_point * block[term] * d[v[k]];
                out[v[k]] += per_point * block[term] * d[v[i]];
            }
            out[v[i]] += per_point * block[term++] * d[v[i]];
        }
    }
    for (size_t b = 0; b < f->bending.count; b++) {
        const qm_bend *bend = &f->bending.bends[b];
        double sum = 0.0;
        for (int k = 0; k < bend->count; k++)
            sum += bend->factor[k] * d[bend->vertex[k]];
        sum *= per_area * bend->weight;
        for (int k = 0; k < bend->count; k++)
            out[bend->vertex[k]] += bend->factor[k] * sum;
    }
    for (size_t i = 0; i < f->mesh.vertex_count; i++)
        if (f->is_fixed[i]) out[i] = 0.0;
}

/** The diagonal of M, 1 where that is 0. */
static void set_diagonal(noise_fit *f, double lambda)
{
    memset(f->diagonal, 0, f->mesh.vertex_count * sizeof *f->diagonal);
    for (size_t face = 0; face < f->mesh.face_count; face++)
        for (int i = 0, term = 0; i < 4; i++, term += i + 1)
            f->diagonal[f->mesh.faces[4 * face + (size_t)i]] += f->block[face][term] / (double)f->equations;
    for (size_t b = 0; b < f->bending.count; b++) {
        const qm_bend *bend = &f->bending.bends[b];
        for (int k = 0; k < bend->count; k++)
            f->diagonal[bend->vertex[k]] +=
                lambda / f->bending.area * bend->weight * bend->factor[k] * bend->factor[k];
    }
    for (size_t i = 0; i < f->mesh.vertex_count; i++)
        if (!(f->diagonal[i] > 0.0)) f->diagonal[i] = 1.0;
}

static double dot(const double *a, const double *b, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/** Solves M x = b by conjugate gradients from the x that is given. rest holds b and becomes what is left. */
static void solve(noise_fit *f, double lambda, double *x)
{
    size_t count = f->mesh.vertex_count;
    double energy = 0.0, start = 0.0;
    for (size_t i = 0; i < count; i++) {
        if (f->is_fixed[i]) f->rest[i] = x[i] = 0.0;
        start += f->rest[i] * f->rest[i] / f->diagonal[i];
    }
    multiply(f, lambda, x, f->image);
    for (size_t i = 0; i < count; i++) {
        f->rest[i] -= f->image[i];
        f->way[i] = f->rest[i] / f->diagonal[i];
        energy += f->rest[i] * f->way[i];
    }
    for (int k = 0; k < ITERATIONS && energy > ACCURACY * ACCURACY * start; k++) {
        multiply(f, lambda, f->way, f->image);
        double slope = dot(f->way, f->image, count), next = 0.0;
        if (!(slope > 0.0)) return;
        for (size_t i = 0; i < count; i++) {
            x[i] += energy / slope * f->way[i];
            f->rest[i] -= energy / slope * f->image[i];
            next += f->rest[i] * f->rest[i] / f->diagonal[i];
        }
        for (size_t i = 0; i < count; i++)
            f->way[i] = f->rest[i] / f->diagonal[i] + next / energy * f->way[i];
        energy = next;
    }
}

/** Solves for the moves. */
static void find_moves(noise_fit *f, double lambda)
{
    for (size_t i = 0; i < f->mesh.vertex_count; i++)
        f->rest[i] = f->right[i] / (double)f->equations;
    for (size_t b = 0; b < f->bending.count; b++) {
        const qm_bend *bend = &f->bending.bends[b];
        for (int k = 0; k < bend->count; k++)
            f->rest[bend->vertex[k]] -=
                lambda / f->bending.area * bend->weight * bend->factor[k] * bend->curvature;
    }
    solve(f, lambda, f->move);
}

/** The number of free parameters that a fit has. */
static double find_trace(noise_fit *f, double lambda)
{
    for (size_t i = 0; i < f->mesh.vertex_count; i++)
        f->rest[i] = f->signs[i] / (double)f->equations;
    solve(f, lambda, f->probe);
    return dot(f->signs, f->probe, f->mesh.vertex_count);
}

/** The sum of the squares of what is left of the residuals. */
static double remaining(const noise_fit *f)
{
    double sum = f->residual2 - 2.0 * dot(f->right, f->move, f->mesh.vertex_count);
    for (size_t face = 0; face < f->mesh.face_count; face++) {
        const uint32_t *v = f->mesh.faces + 4 * face;
        for (int i = 0, term = 0; i < 4; i++)
            for (int k = 0; k <= i; k++, term++)
                sum += (k < i ? 2.0 : 1.0) * f->block[face][term] * f->move[v[i]] * f->move[v[k]];
    }
    return fmax(sum, 0.0);
}

/** The estimate of the error of a fit that is to be least. */
static double score(const noise_fit *f, double share, bool is_given)
{
    double mean = remaining(f) / (double)f->equations, kept = 1.0 - qm_clamp(share, 0.0, 0.99);
    return is_given ? mean + 2.0 * f->sigma * f->sigma * share : mean / (kept * kept);
}

static double fourth_power(double length)
{
    return length * length * length * length;
}

/** Solves for the moves of a length of averaging. Returns the share of the equations that are free parameters. */
static double solve_length(noise_fit *f, double length)
{
    double lambda = fourth_power(length);
    set_diagonal(f, lambda);
    find_moves(f, lambda);
    return find_trace(f, lambda) / (double)f->equations;
}

/** Solves with the first length that leaves few free parameters: the surface that the points are projected on next. */
static void solve_smooth(noise_fit *f)
{
    double length = FIRST_LENGTH * f->edge;
    for (int k = 0; k < LENGTHS && solve_length(f, length) > SMOOTH_SHARE; k++)
        length *= LENGTH_RATIO;
}

/** Tries growing lengths of averaging until the error has risen, and solves for the best. */
static void solve_best(noise_fit *f, bool is_given)
{
    double best = INFINITY, length = FIRST_LENGTH * f->edge, best_length = length;
    for (int k = 0, rises = 0; k < LENGTHS && rises < RISES && !qm_context_canceled(f->ctx); k++) {
        double here = score(f, solve_length(f, length), is_given);
        rises = here < best ? 0 : rises + 1;
        if (here < best) {
            best = here;
            best_length = length;
        }
        length *= LENGTH_RATIO;
    }
    set_diagonal(f, fourth_power(best_length));
    find_moves(f, fourth_power(best_length));
}

/** Limits the moves to the longest edge at each vertex. */
static void limit_moves(noise_fit *f)
{
    const qm_mesh *mesh = &f->mesh;
    double *longest = f->image;
    memset(longest, 0, mesh->vertex_count * sizeof *longest);
    for (size_t face = 0; face < mesh->face_count; face++) {
        const uint32_t *v = mesh->faces + 4 * face;
        for (int k = 0; k < 4; k++) {
            uint32_t a = v[k], b = v[(k + 1) % 4];
            double length = qm_vec_distance(vertex_at(f, a), vertex_at(f, b));
            longest[a] = fmax(longest[a], length);
            longest[b] = fmax(longest[b], length);
        }
    }
    for (size_t i = 0; i < mesh->vertex_count; i++)
        f->move[i] = qm_clamp(f->move[i], -MAX_MOVE * longest[i], MAX_MOVE * longest[i]);
}

static qm_vec moved(const noise_fit *f, uint32_t vertex)
{
    return qm_vec_axpy(vertex_at(f, vertex), f->move[vertex], f->normal[vertex]);
}

/** True if the moves make a quad worse than the limit, or turn it over. */
static bool is_spoilt(const noise_fit *f, size_t face)
{
    const uint32_t *v = f->mesh.faces + 4 * face;
    qm_vec before[4], after[4];
    for (int k = 0; k < 4; k++) {
        before[k] = vertex_at(f, v[k]);
        after[k] = moved(f, v[k]);
    }
    double sine = qm_quad_min_sine(after);
    return (sine < MIN_SINE && sine < qm_quad_min_sine(before)) ||
           qm_vec_dot(qm_quad_normal(before), qm_quad_normal(after)) <= 0.0;
}

/** Moves the vertices of the mesh. Moves that spoil a quad are halved, and are none at last. */
static void apply(noise_fit *f)
{
    bool is_changing = true;
    limit_moves(f);
    for (int round = 0; round <= HALVINGS && is_changing; round++) {
        is_changing = false;
        memset(f->image, 0, f->mesh.vertex_count * sizeof *f->image);
        for (size_t face = 0; face < f->mesh.face_count; face++) {
            if (!is_spoilt(f, face)) continue;
            for (int k = 0; k < 4; k++)
                f->image[f->mesh.faces[4 * face + (size_t)k]] = 1.0;
            is_changing = true;
        }
        for (size_t i = 0; i < f->mesh.vertex_count; i++)
            if (f->image[i] > 0.0) f->move[i] *= round < HALVINGS ? 0.5 : 0.0;
    }
    for (size_t i = 0; i < f->mesh.vertex_count; i++)
        qm_vec_store(f->mesh.positions + 3 * i, moved(f, (uint32_t)i));
}

/** Sets the worst scaled Jacobian of the quads round each vertex, of quads that lie against their vertices' normals -1. False if none is
 * below the limit. */
static bool find_worst(const noise_fit *f, double *worst)
{
    bool is_any = false;
    for (size_t i = 0; i < f->mesh.vertex_count; i++)
        worst[i] = 1.0;
    for (size_t face = 0; face < f->mesh.face_count; face++) {
        const uint32_t *v = f->mesh.faces + 4 * face;
        qm_vec corner[4], normal = {0, 0, 0};
        for (int k = 0; k < 4; k++) {
            corner[k] = vertex_at(f, v[k]);
            normal = qm_vec_add(normal, f->normal[v[k]]);
        }
        double sine = qm_vec_dot(qm_quad_normal(corner), normal) > 0.0 ? qm_quad_min_sine(corner) : -1.0;
        is_any |= sine < MIN_SINE;
        for (int k = 0; k < 4; k++)
            worst[v[k]] = fmin(worst[v[k]], sine);
    }
    return is_any;
}

/** Sets for each vertex the way to the mean of its neighbours within the tangent plane. */
static void find_ways(const noise_fit *f, qm_vec *way, double *count)
{
    for (size_t i = 0; i < f->mesh.vertex_count; i++) {
        way[i] = (qm_vec){0, 0, 0};
        count[i] = 0.0;
    }
    for (size_t c = 0; c < 4 * f->mesh.face_count; c++) {
        uint32_t a = f->mesh.faces[c], b = f->mesh.faces[(c & ~(size_t)3) + ((c + 1) & 3)];
        qm_vec edge = qm_vec_sub(vertex_at(f, b), vertex_at(f, a));
        way[a] = qm_vec_add(way[a], edge);
        way[b] = qm_vec_sub(way[b], edge);
        count[a] += 1.0;
        count[b] += 1.0;
    }
    for (size_t i = 0; i < f->mesh.vertex_count; i++) {
        if (count[i] > 0.0) way[i] = qm_vec_scale(1.0 / count[i], way[i]);
        way[i] = qm_vec_axpy(way[i], -qm_vec_dot(way[i], f->normal[i]), f->normal[i]);
    }
}

/**
 * Opens folded quads, which lattices alone cannot where curves are folded: their vertices go part of the way to the mean of their neighbours,
 * many at once, and those back whose quads are worse then. QM_OK or QM_E_NO_MEMORY.
 */
static qm_status open_quads(noise_fit *f)
{
    size_t vertices = f->mesh.vertex_count;
    qm_vec *way = qm_context_alloc(f->ctx, vertices, sizeof *way);
    if (!way) return no_memory(f->ctx);
    double *before = f->rest, *after = f->image;
    set_normals(f);
    for (int round = 0; round < OPENINGS && find_worst(f, before); round++) {
        double share = round % 2 ? 0.25 : 0.5;
        find_ways(f, way, f->way);
        for (int pass = 0; pass < 2; pass++) {
            for (size_t i = 0; i < vertices; i++) {
                /* Of two that are in each other's way one tries at a time. */
                bool is_tried =
                    before[i] < MIN_SINE && !f->is_fixed[i] && sign_of(i * OPENINGS + (size_t)round) > 0.0;
                double sign = pass == 0 ? share : -share, *at = f->mesh.positions + 3 * i;
                if (is_tried && (pass == 0 || after[i] <= before[i]))
                    qm_vec_store(at, qm_vec_axpy(qm_vec_load(at), sign, way[i]));
            }
            if (pass == 0) find_worst(f, after);
        }
    }
    qm_context_free(f->ctx, way, vertices, sizeof *way);
    return QM_OK;
}

/** Marks the vertices that must stay: of curves that are kept where they were drawn, and of lattices that are not stale. */
static void mark_fixed(const qm_reconstruction *r, const size_t *first, bool only_stale, noise_fit *f)
{
    for (size_t i = 0; i < f->mesh.vertex_count; i++)
        f->is_fixed[i] = false;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        const qm_lattice *lattice = &r->lattices[p];
        bool is_kept = only_stale && !lattice->is_stale;
        for (uint32_t j = 0; j < lattice->rows; j++)
            for (uint32_t i = 0; i < lattice->columns; i++) {
                const uint32_t *v = f->mesh.faces + 4 * (first[p] + (size_t)j * lattice->columns + i);
                const bool low = j == 0, left = i == 0, high = j + 1 == lattice->rows,
                           right = i + 1 == lattice->columns;
                const bool on_border[4] = {low || left, low || right, high || right, high || left};
                for (int k = 0; k < 4; k++)
                    if (is_kept || (on_border[k] && !r->options.pull_curves)) f->is_fixed[v[k]] = true;
            }
    }
}

/** One round: projects the points onto the lattices, and fits these: smoothly, or as the points allow. */
static qm_status fit_round(qm_context *ctx, qm_reconstruction *r, qm_samples *samples, bool is_smooth,
                           bool only_stale, double sigma, double turn, const size_t *first)
{
    qm_status status = qm_samples_project(ctx, r, samples);
    if (status != QM_OK) return status;
    noise_fit fit;
    status = create_fit(ctx, r, &fit);
    if (status == QM_OK) {
        mark_fixed(r, first, only_stale, &fit);
        fit.sigma = sigma * fit.scale;
        fit.turn = turn;
        add_points(&fit, r, samples, first);
        if (fit.equations > 0 && fit.bending.area > 0.0) {
            memset(fit.move, 0, fit.mesh.vertex_count * sizeof *fit.move);
            memset(fit.probe, 0, fit.mesh.vertex_count * sizeof *fit.probe);
            if (is_smooth)
                solve_smooth(&fit);
            else
                solve_best(&fit, r->options.noise_share > 0.0);
            apply(&fit);
            status = open_quads(&fit);
        }
        scale_mesh(&fit, 1.0 / fit.scale);
        if (status == QM_OK) status = qm_lattices_set(ctx, r, &fit.mesh);
        if (status == QM_OK && qm_context_canceled(ctx))
            status = qm_context_fail(ctx, QM_E_CANCELED, "reconstruction canceled");
    }
    free_fit(&fit);
    return status;
}

qm_status qm_noise_fit_lattices(qm_context *ctx, qm_reconstruction *r, bool only_stale)
{
    if (!r->guide) return QM_OK;
    double sigma, turn;
    const qm_noise_points *data = qm_guide_points(r->guide, &sigma, &turn);
    size_t patches = r->layout.patch_count, *first = qm_context_alloc(ctx, patches, sizeof *first), faces = 0;
    /* The points are only read. */
    qm_samples samples = {.count = data->count, .positions = data->positions, .normals = data->normals};
    samples.location = qm_context_alloc(ctx, data->count, sizeof *samples.location);
    qm_status status = first && samples.location ? QM_OK : no_memory(ctx);
    for (size_t p = 0; p < patches && status == QM_OK; p++) {
        first[p] = faces;
        faces += (size_t)r->lattices[p].columns * r->lattices[p].rows;
    }
    if (status == QM_OK) status = fit_round(ctx, r, &samples, true, only_stale, sigma, turn, first);
    if (status == QM_OK) status = fit_round(ctx, r, &samples, false, only_stale, sigma, turn, first);
    for (size_t p = 0; p < patches && status == QM_OK; p++) {
        if (r->lattices[p].spans_hole || (only_stale && !r->lattices[p].is_stale)) continue;
        if (qm_context_canceled(ctx)) status = qm_context_fail(ctx, QM_E_CANCELED, "reconstruction canceled");
        if (status == QM_OK) qm_lattice_untangle(&r->surface, &r->lattices[p]);
    }
    qm_context_free(ctx, first, patches, sizeof *first);
    qm_context_free(ctx, samples.location, data->count, sizeof *samples.location);
    return status;
}
