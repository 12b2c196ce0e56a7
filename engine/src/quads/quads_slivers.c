/**
 * quads_slivers.c: triangles without a height: files of machined parts have them where a corner lies on the side of a face. Their
 * normals mean nothing, so no crease is found at them, and a crease beside one would be lost.
 */
#include "quads/quads_internal.h"

#define FLAT 1e-6   /* height of a sliver, in lengths of its longest edge, at most */
#define NEEDLE 1e-3 /* shortest edge of a needle, likewise; other slivers have a corner on the longest edge */
#define MAX_ROUNDS 32 /* a sliver that goes can leave another */

/** Takes a sliver away: the short edge of a needle is contracted, the longest edge of another one turned. False for other faces,
 * and where the topology does not allow it. */
static bool drop(qm_trimesh *m, uint32_t face)
{
    uint32_t longest = 3 * face, shortest = 3 * face;
    double longest2 = 0.0, shortest2 = INFINITY;
    for (uint32_t h = 3 * face; h < 3 * face + 3; h++) {
        double length2 = qm_vec_norm2(qm_trimesh_edge(m, h));
        if (length2 > longest2) longest = h, longest2 = length2;
        if (length2 < shortest2) shortest = h, shortest2 = length2;
    }
    if (qm_vec_norm(qm_trimesh_normal(m, face)) > FLAT * longest2) return false;
    if (shortest2 <= NEEDLE * NEEDLE * longest2) {
        if (!qm_trimesh_can_collapse(m, shortest)) return false;
        qm_trimesh_collapse(m, shortest);
        return true;
    }
    if (m->twin[longest] == QM_NO_INDEX || !qm_trimesh_can_flip(m, longest)) return false;
    qm_trimesh_flip(m, longest);
    return true;
}

void qm_quads_drop_slivers(qm_trimesh *m)
{
    bool is_changing = true;
    for (int round = 0; round < MAX_ROUNDS && is_changing; round++) {
        is_changing = false;
        for (uint32_t f = 0; f < m->face_count; f++)
            if (qm_trimesh_has_face(m, f)) is_changing |= drop(m, f);
    }
    qm_trimesh_compact(m);
}
