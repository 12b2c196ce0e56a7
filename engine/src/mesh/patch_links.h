/**
 * patch_links.h: which quad lies across each side of a quad, and how to walk over them.
 *
 * Side s of a face runs from its corner s to corner s + 1. A link names the face and side beyond, and whether
 * the two faces wind in opposite ways (then both sides run from the same end).
 */
#ifndef QM_PATCH_LINKS_H
#define QM_PATCH_LINKS_H

#include "qm/mesh.h"

#define QM_NO_LINK UINT32_MAX

/** One side of a quad, or a step along it: for a step, end is the corner of the face that it leads to. */
typedef struct qm_quad_side {
    uint32_t face;
    uint32_t side; /* 0 to 3 */
} qm_quad_side;

typedef struct qm_patch_links {
    size_t face_count;
    uint32_t *across; /* 4 a face: (face * 4 + side) * 2 + same way, or QM_NO_LINK */
    uint8_t *cuts;    /* a bit a side: patches end here; set wherever there is no link */
} qm_patch_links;

/**
 * Links the quads of a mesh across every edge that has just two faces, both of them quads that name no vertex
 * twice. Returns QM_OK, QM_E_NO_MEMORY or QM_E_CANCELED; qm_patch_links_reset frees either way.
 */
qm_status qm_patch_links_find(qm_context *ctx, const qm_mesh *mesh, qm_patch_links *out);

void qm_patch_links_reset(qm_context *ctx, qm_patch_links *links);

static inline bool qm_links_is_cut(const qm_patch_links *links, qm_quad_side at)
{
    return links->cuts[at.face] >> at.side & 1;
}

/** The side beyond; there is one. *same_way is set where the two faces wind in opposite ways. */
static inline qm_quad_side qm_links_across(const qm_patch_links *links, qm_quad_side at, bool *same_way)
{
    uint32_t link = links->across[4 * (size_t)at.face + at.side];
    *same_way = link & 1;
    return (qm_quad_side){link >> 3, link >> 1 & 3};
}

static inline bool qm_links_has(const qm_patch_links *links, qm_quad_side at)
{
    return links->across[4 * (size_t)at.face + at.side] != QM_NO_LINK;
}

/** Makes a side and the one beyond it a cut, or takes the cut away where there is a link. */
static inline void qm_links_set_cut(const qm_patch_links *links, qm_quad_side at, bool cut)
{
    bool same_way;
    qm_quad_side beyond = qm_links_across(links, at, &same_way);
    if (cut) {
        links->cuts[at.face] |= (uint8_t)(1u << at.side);
        links->cuts[beyond.face] |= (uint8_t)(1u << beyond.side);
    } else {
        links->cuts[at.face] &= (uint8_t) ~(1u << at.side);
        links->cuts[beyond.face] &= (uint8_t) ~(1u << beyond.side);
    }
}

/** A side of a face, and the corner at one of its ends: place in the fan of faces round that vertex. */
typedef struct qm_spoke {
    qm_quad_side at;
    uint32_t corner; /* of at.face: at.side or at.side + 1, modulo 4 */
} qm_spoke;

/** The other side of the same face at the same corner. */
static inline qm_spoke qm_spoke_turn(qm_spoke spoke)
{
    bool is_start = spoke.corner == spoke.at.side;
    spoke.at.side = (is_start ? spoke.at.side + 3 : spoke.at.side + 1) & 3;
    return spoke;
}

/** The same side and corner, seen from the face beyond; there is one. */
static inline qm_spoke qm_spoke_cross(const qm_patch_links *links, qm_spoke spoke)
{
    bool same_way, is_start = spoke.corner == spoke.at.side;
    qm_quad_side beyond = qm_links_across(links, spoke.at, &same_way);
    return (qm_spoke){beyond, (is_start == same_way ? beyond.side : beyond.side + 1) & 3};
}

/** The same side from its other end. */
static inline qm_spoke qm_spoke_reverse(qm_spoke spoke)
{
    spoke.corner = (spoke.corner == spoke.at.side ? spoke.at.side + 1 : spoke.at.side) & 3;
    return spoke;
}

#endif
