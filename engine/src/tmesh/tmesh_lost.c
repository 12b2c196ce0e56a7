/**
 * tmesh_lost.c: places that lattices have left. A lattice that slides off a limb is neither folded nor crossed, and misses it.
 */
#include "tmesh/tmesh_lattice.h"

#define LOST 3.0 /* mean distances between the places of neighbours: so far away a place is left */

/** A point's neighbour number n of those that its cells have; each is met twice inside. */
static uint32_t neighbour(const qm_tmesh_lattice *lattice, uint32_t index, uint32_t n)
{
    uint32_t at = lattice->at[lattice->first_at[index] + n / 2];
    return lattice->cells[at / 4].corner[(at + (n & 1 ? 3 : 1)) & 3];
}

static uint32_t neighbour_count(const qm_tmesh_lattice *lattice, uint32_t index)
{
    return 2 * (lattice->first_at[index + 1] - lattice->first_at[index]);
}

/** How far the place that a point started at is from the lattice now: from there over neighbours that are nearer. */
static double distance_of_place(const qm_tmesh_lattice *lattice, uint32_t index)
{
    const qm_tmesh_point *points = lattice->points;
    qm_vec place = points[index].pin;
    double least = qm_vec_distance(place, points[index].at);
    for (bool is_nearer = true; is_nearer;) {
        uint32_t from = index;
        is_nearer = false;
        for (uint32_t n = 0; n < neighbour_count(lattice, from); n++) {
            uint32_t other = neighbour(lattice, from, n);
            double distance = qm_vec_distance(place, points[other].at);
            if (!(distance < least)) continue;
            least = distance;
            index = other;
            is_nearer = true;
        }
    }
    return least;
}

bool qm_tmesh_is_lost(const qm_tmesh_lattice *lattice, uint32_t index)
{
    double sum = 0;
    uint32_t count = neighbour_count(lattice, index);
    for (uint32_t n = 0; n < count; n++)
        sum += qm_vec_distance(lattice->points[index].pin, lattice->points[neighbour(lattice, index, n)].pin);
    return count > 0 && distance_of_place(lattice, index) > LOST * sum / count;
}
