/**
 * frames.h: frames of triangles (bvh_tree.h tells what they are), a lane each, in the precision of whoever
 * includes this: WIDE is the vector, WIDE_MASK what comparisons of it give, WIDE_SET, WIDE_SQRT and
 * WIDE_SELECT work on it, WIDE_FLAT is the height, as a share of the length, below which a triangle is a
 * segment, and WIDE_SHORT the squared length up to which it is a point. The same steps as qm_triangle_make,
 * with selections in place of branches.
 */
typedef struct wide_vec {
    WIDE x, y, z;
} wide_vec;

/** Origin at an end of the longest edge, x along it, y in the plane; the corners are (0, 0), (length, 0) and
 * (cx, cy). */
typedef struct wide_frame {
    wide_vec origin, x, y;
    WIDE length, cx, cy;
} wide_frame;

static inline wide_vec wide_sub(wide_vec a, wide_vec b)
{
    return (wide_vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline wide_vec wide_scale(WIDE s, wide_vec a)
{
    return (wide_vec){s * a.x, s * a.y, s * a.z};
}

static inline wide_vec wide_axpy(wide_vec a, WIDE s, wide_vec b)
{
    return (wide_vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static inline WIDE wide_dot(wide_vec a, wide_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline wide_vec wide_select(WIDE_MASK mask, wide_vec a, wide_vec b)
{
    return (wide_vec){WIDE_SELECT(mask, a.x, b.x), WIDE_SELECT(mask, a.y, b.y), WIDE_SELECT(mask, a.z, b.z)};
}

/** Unit vector at a right angle to the unit vector x. */
static inline wide_vec any_perpendicular(wide_vec x)
{
    const WIDE zero = {0};
    wide_vec y =
        wide_select(x.x * x.x < WIDE_SET(0.36), (wide_vec){zero, x.z, -x.y}, (wide_vec){-x.z, zero, x.x});
    return wide_scale(WIDE_SET(1.0) / WIDE_SQRT(wide_dot(y, y)), y);
}

static inline wide_vec height_direction(wide_vec third, wide_vec x, WIDE length)
{
    const WIDE one = WIDE_SET(1.0);
    wide_vec y = wide_axpy(third, -wide_dot(third, x), x);
    WIDE height = WIDE_SQRT(wide_dot(y, y));
    WIDE_MASK is_tall = height > WIDE_SET(WIDE_FLAT) * length;
    y = wide_scale(one / WIDE_SELECT(is_tall, height, one), y);
    y = wide_axpy(y, -wide_dot(y, x), x);
    WIDE norm = WIDE_SQRT(wide_dot(y, y));
    y = wide_scale(one / WIDE_SELECT(is_tall, norm, one), y);
    return wide_select(is_tall, y, any_perpendicular(x));
}

static inline wide_frame wide_frame_make(wide_vec a, wide_vec b, wide_vec c)
{
    wide_vec ab = wide_sub(b, a), bc = wide_sub(c, b), ca = wide_sub(a, c);
    WIDE longest2 = wide_dot(ab, ab), bc2 = wide_dot(bc, bc), ca2 = wide_dot(ca, ca);
    WIDE_MASK from_b = bc2 > longest2;
    longest2 = WIDE_SELECT(from_b, bc2, longest2);
    WIDE_MASK from_c = ca2 > longest2;
    longest2 = WIDE_SELECT(from_c, ca2, longest2);
    wide_vec origin = wide_select(from_c, c, wide_select(from_b, b, a));
    wide_vec second = wide_select(from_c, a, wide_select(from_b, c, b));
    wide_vec third = wide_sub(wide_select(from_c, b, wide_select(from_b, a, c)), origin);

    const WIDE zero = {0}, one = WIDE_SET(1.0);
    WIDE_MASK is_long = longest2 > WIDE_SET(WIDE_SHORT);
    WIDE length = WIDE_SELECT(is_long, WIDE_SQRT(longest2), zero);
    wide_vec x = wide_scale(one / WIDE_SELECT(is_long, length, one), wide_sub(second, origin));
    x = wide_select(is_long, x, (wide_vec){one, zero, zero});
    wide_vec y = height_direction(third, x, length);
    return (wide_frame){origin, x, y, length, wide_dot(third, x), wide_dot(third, y)};
}
