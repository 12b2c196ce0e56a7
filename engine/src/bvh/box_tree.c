#include "box_tree.h"

#include <string.h>

bool qm_box_tree_init(qm_context *ctx, size_t count, qm_box_tree *out)
{
    *out = (qm_box_tree){.group_count = {count}};
    do {
        count = (count + 7) / 8;
        int level = ++out->level_count;
        out->group_count[level] = count;
        out->groups[level] = qm_context_alloc_aligned(ctx, count, sizeof *out->groups[level]);
        if (!out->groups[level]) return false;
        memset(&out->groups[level][count - 1], 0, sizeof *out->groups[level]);
    } while (count > 1);
    return true;
}

void qm_box_tree_reset(qm_context *ctx, qm_box_tree *tree)
{
    for (int level = 1; level <= tree->level_count; level++)
        qm_context_free_aligned(ctx, tree->groups[level], tree->group_count[level],
                                sizeof *tree->groups[level]);
    *tree = (qm_box_tree){0};
}

/** The box of group i of a level below, as a member of the level above; floats are copied, so nothing is lost
 * on the way up. */
static void fill_member(qm_box_tree *tree, int level, size_t i)
{
    const qm_box_node *below = &tree->groups[level - 1][i];
    qm_box_node *here = &tree->groups[level][i / 8];
    int members = qm_box_tree_child_count(tree, level - 1, i);
    for (int k = 0; k < 3; k++) {
        float low = below->low[k][0], high = below->high[k][0];
        for (int m = 1; m < members; m++) {
            if (below->low[k][m] < low) low = below->low[k][m];
            if (below->high[k][m] > high) high = below->high[k][m];
        }
        here->low[k][i % 8] = low;
        here->high[k][i % 8] = high;
    }
}

void qm_box_tree_fill_children(qm_box_tree *tree, int level, size_t begin, size_t end)
{
    for (size_t i = begin; i < end; i++)
        fill_member(tree, level, i);
}

void qm_box_tree_fill(qm_box_tree *tree, int first)
{
    for (int level = first; level <= tree->level_count; level++)
        qm_box_tree_fill_children(tree, level, 0, tree->group_count[level - 1]);
}

size_t qm_box_tree_refill(qm_box_tree *tree, uint32_t *members, size_t count)
{
    size_t made = 0;
    for (int level = 2; level <= tree->level_count; level++) {
        size_t kept = 0;
        for (size_t i = 0; i < count; i++) {
            uint32_t group = members[i] / 8;
            if (kept > 0 && members[kept - 1] == group) continue;
            members[kept++] = group;
            fill_member(tree, level, group);
        }
        made += count = kept;
    }
    return made;
}

qm_box qm_box_tree_whole(const qm_box_tree *tree)
{
    const qm_box_node *top = &tree->groups[tree->level_count][0];
    qm_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int m = 0; m < qm_box_tree_child_count(tree, tree->level_count, 0); m++) {
        for (int k = 0; k < 3; k++) {
            box.min[k] = fmin(box.min[k], (double)top->low[k][m]);
            box.max[k] = fmax(box.max[k], (double)top->high[k][m]);
        }
    }
    return box;
}

double qm_box_tree_reach(const qm_box_tree *tree)
{
    qm_box box = qm_box_tree_whole(tree);
    double reach = 0.0;
    for (int k = 0; k < 3; k++)
        reach = fmax(reach, fmax(-box.min[k], box.max[k]));
    return fmin(reach, 1.0);
}

size_t qm_box_tree_memory_size(const qm_box_tree *tree)
{
    size_t size = 0;
    for (int level = 1; level <= tree->level_count; level++)
        size += tree->group_count[level] * sizeof *tree->groups[level];
    return size;
}
