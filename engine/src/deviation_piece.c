#include "deviation_piece.h"

#include "deviation_bound.h"
#include "deviation_cut.h"

#define HALVED_LEVELS 4 /* on the last of so many levels each piece is halved */

void qm_piece_bound(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                    qm_piece_bounds *out)
{
    qm_piece_face face = qm_piece_face_load(maker, piece);
    qm_piece_shape shape = qm_piece_shape_make(maker, &face, piece);
    qm_piece_list_near(maker, &shape, desk);
    qm_piece_bound_near(maker, &shape, desk, out);
}

int qm_piece_split(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                   qm_source_piece part[QM_PIECE_PARTS], qm_piece_bounds bounds[QM_PIECE_PARTS])
{
    qm_piece_face face = qm_piece_face_load(maker, piece);
    qm_piece_shape shape = qm_piece_shape_make(maker, &face, piece);
    qm_piece_list_near(maker, &shape, desk);
    bool is_complete = desk->near.is_complete;
    int count = 1;
    if (is_complete && piece->depth % HALVED_LEVELS != HALVED_LEVELS - 1)
        count = qm_piece_cut_by_facets(maker, &face, piece, &desk->near, part);
    if (count == 1) {
        qm_piece_halve(&shape, piece, part);
        count = 2;
    }
    for (int i = 0; i < count; i++) {
        qm_piece_shape here = qm_piece_shape_make(maker, &face, &part[i]);
        if (!is_complete) qm_piece_list_near(maker, &here, desk);
        qm_piece_bound_near(maker, &here, desk, &bounds[i]);
    }
    return count;
}

qm_piece_bounds qm_piece_bound_point(double distance, double eta)
{
    double low = distance - eta, high = distance + eta, sure = fmax(0.0, low);
    return (qm_piece_bounds){
        .low = {low, low, low},
        .high = {high, high, high},
        .area_low = 1.0,
        .area_high = 1.0,
        .density_low = 1.0,
        .density_high = 1.0,
        .mean_low = sure,
        .mean_high = high,
        .square_low = sure * sure,
        .square_high = high * high,
    };
}
