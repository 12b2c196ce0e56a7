/**
 * bvh_fingerprint.c: a number for all that the nodes and packs of a tree mean: the surface, its faces in their packs, and
 * the frame that rounding margins come from.
 */
#include <string.h>

#include "bvh_tree.h"

#define WORD 8 /* bytes */

/** Mixes a word in: the multiplier of SplitMix64 (Steele, Lea, Flood 2014) spreads it over the upper bits, the shift over
 * the lower ones. */
static uint64_t mix(uint64_t hash, uint64_t word)
{
    hash = (hash ^ word) * 0xbf58476d1ce4e5b9u;
    return hash ^ hash >> 32;
}

static uint64_t mix_bytes(uint64_t hash, const void *bytes, size_t size)
{
    const unsigned char *at = bytes;
    hash = mix(hash, size);
    for (; size > 0; at += WORD) {
        uint64_t word = 0;
        size_t taken = size < WORD ? size : WORD;
        memcpy(&word, at, taken);
        hash = mix(hash, word);
        size -= taken;
    }
    return hash;
}

uint64_t qm_bvh_fingerprint(const qm_bvh *bvh)
{
    QM_ASSERT(bvh);
    const qm_mesh *mesh = &bvh->mesh;
    const double frame[] = {bvh->frame.origin.x, bvh->frame.origin.y, bvh->frame.origin.z, bvh->frame.scale,
                            bvh->reach};
    uint64_t hash = mix_bytes(0, frame, sizeof frame);
    hash = mix_bytes(hash, mesh->positions, 3 * mesh->vertex_count * sizeof *mesh->positions);
    hash = mix_bytes(hash, mesh->faces, 4 * mesh->face_count * sizeof *mesh->faces);
    for (size_t i = 0; i < bvh->pack_count; i++) {
        const qm_pack_lanes *lanes = &bvh->lanes[i];
        hash = mix_bytes(hash, lanes->face, lanes->lane_count * sizeof *lanes->face);
    }
    return hash;
}
