/**
 * box_tree.c: boxes from the leaves up.
 */
#include "box_tree.h"

#include <string.h>

bool qm_box_tree_init(qm_context *ctx, size_t count, qm_box_tree *out)
{
    QM_ASSERT(count >= 1);
    *out = (qm_box_tree){.group_count = {count}};
    do {
        count = (count + 7) / 8;
        int level = ++out->level_count;
        QM_ASSERT(level < QM_TREE_LEVELS);
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

/** Sets the box of node i of level - 1 as a child at level; floats are copied, so no margin is added on the
 * way up. */
static void fill_child(qm_box_tree *tree, int level, size_t i)
{
    const qm_box_node *from = &tree->groups[level - 1][i];
    qm_box_node *parent = &tree->groups[level][i / 8];
    int children = qm_box_tree_child_count(tree, level - 1, i);
    for (int k = 0; k < 3; k++) {
        float low = from->low[k][0], high = from->high[k][0];
        for (int j = 1; j < children; j++) {
            if (from->low[k][j] < low) low = from->low[k][j];
            if (from->high[k][j] > high) high = from->high[k][j];
        }
        parent->low[k][i % 8] = low;
        parent->high[k][i % 8] = high;
    }
}

void qm_box_tree_fill_children(qm_box_tree *tree, int level, size_t begin, size_t end)
{
    QM_ASSERT(level >= 2 && level <= tree->level_count && end <= tree->group_count[level - 1]);
    for (size_t i = begin; i < end; i++)
        fill_child(tree, level, i);
}

void qm_box_tree_fill(qm_box_tree *tree, int first)
{
    for (int level = first; level <= tree->level_count; level++)
        qm_box_tree_fill_children(tree, level, 0, tree->group_count[level - 1]);
}

size_t qm_box_tree_refill(qm_box_tree *tree, uint32_t *leaves, size_t count)
{
    size_t filled = 0;
    for (int level = 2; level <= tree->level_count; level++) {
        size_t kept = 0;
        for (size_t i = 0; i < count; i++) {
            uint32_t node = leaves[i] / 8;
            QM_ASSERT(kept == 0 || node >= leaves[kept - 1]);
            if (kept > 0 && leaves[kept - 1] == node) continue;
            leaves[kept++] = node;
            fill_child(tree, level, node);
        }
        filled += count = kept;
    }
    return filled;
}

qm_box qm_box_tree_bounds(const qm_box_tree *tree)
{
    const qm_box_node *root = &tree->groups[tree->level_count][0];
    qm_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int i = 0; i < qm_box_tree_child_count(tree, tree->level_count, 0); i++) {
        for (int k = 0; k < 3; k++) {
            box.min[k] = fmin(box.min[k], (double)root->low[k][i]);
            box.max[k] = fmax(box.max[k], (double)root->high[k][i]);
        }
    }
    return box;
}

double qm_box_tree_max_coordinate(const qm_box_tree *tree)
{
    qm_box box = qm_box_tree_bounds(tree);
    double max = 0.0;
    for (int k = 0; k < 3; k++)
        max = fmax(max, fmax(-box.min[k], box.max[k]));
    return fmin(max, 1.0);
}

size_t qm_box_tree_memory_size(const qm_box_tree *tree)
{
    size_t size = 0;
    for (int level = 1; level <= tree->level_count; level++)
        size += tree->group_count[level] * sizeof *tree->groups[level];
    return size;
}
