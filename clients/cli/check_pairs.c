/**
 * check_pairs.c: which files are held against each other: two, those of two folders with equal names, or those that a
 * manifest lists.
 */
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "check.h"

enum { MAX_DEPTH = 16 }; /* of folders in folders */

static bool is_folder(const char *path)
{
    struct stat info;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

/* ---- the meshes of a folder ---- */

/** Paths below a folder, sorted. */
typedef struct name_list {
    char **names;
    size_t count, capacity;
} name_list;

static bool add_name(name_list *list, const char *name)
{
    if (list->count == list->capacity) {
        size_t capacity = 2 * list->capacity + 16;
        char **names = realloc(list->names, capacity * sizeof *names);
        if (!names) return false;
        list->names = names;
        list->capacity = capacity;
    }
    list->names[list->count] = strdup(name);
    return list->names[list->count++] != NULL;
}

static void reset_names(name_list *list)
{
    for (size_t i = 0; i < list->count; i++)
        free(list->names[i]);
    free(list->names);
    *list = (name_list){0};
}

/** The path of a name in a folder, for free(). */
static char *join(const char *folder, const char *name)
{
    size_t size = strlen(folder) + strlen(name) + 2;
    char *path = malloc(size);
    bool needs_slash = *folder && *name && !cli_path_ends_in(folder, "/");
    if (path) snprintf(path, size, "%s%s%s", folder, needs_slash ? "/" : "", name);
    return path;
}

static bool list_folder(const char *root, const char *below, int depth, name_list *list);

/** Adds an entry of a folder, or what is below it. A link that leads nowhere is a file, which cannot be read when its turn comes. */
static bool list_entry(const char *root, const char *name, int depth, name_list *list)
{
    char *path = join(root, name);
    bool has_more = path && is_folder(path);
    if (has_more) {
        free(path);
        return list_folder(root, name, depth + 1, list);
    }
    bool is_listed = path && (qm_format_from_path(name) == QM_FORMAT_UNKNOWN || add_name(list, name));
    free(path);
    if (!is_listed) cli_print_problem(root, NAN, NAN, "out of memory for the names");
    return is_listed;
}

/** Adds the mesh files below root/below; hidden ones and other files are left out. False after a report. */
static bool list_folder(const char *root, const char *below, int depth, name_list *list)
{
    char *folder = join(root, below);
    DIR *directory = folder && depth <= MAX_DEPTH ? opendir(folder) : NULL;
    bool is_complete = directory != NULL;
    if (folder && depth > MAX_DEPTH)
        cli_print_problem(folder, NAN, NAN, "folders are too deep in one another, or a link leads back");
    else if (!is_complete)
        cli_print_problem(folder ? folder : root, NAN, NAN, "the folder cannot be read");
    for (const struct dirent *entry; is_complete && (entry = readdir(directory));) {
        if (entry->d_name[0] == '.') continue;
        char *name = join(below, entry->d_name);
        if (!name) cli_print_problem(folder, NAN, NAN, "out of memory for the names");
        is_complete = name && list_entry(root, name, depth, list);
        free(name);
    }
    if (directory) closedir(directory);
    free(folder);
    return is_complete;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/** The name without the ending of its format. */
static size_t stem_length(const char *name)
{
    size_t length = strlen(name);
    if (cli_path_ends_in(name, ".gz")) length -= 3;
    for (size_t i = length; i > 0 && name[i - 1] != '/'; i--)
        if (name[i - 1] == '.') return i - 1;
    return length;
}

static bool has_stem_of(const char *a, const char *b)
{
    size_t length = stem_length(a);
    return length == stem_length(b) && strncmp(a, b, length) == 0;
}

/** The only name in a list with the stem of this one, or its count. */
static size_t find_stem(const name_list *list, const char *name)
{
    size_t found = list->count;
    for (size_t i = 0; i < list->count; i++) {
        if (!list->names[i] || !has_stem_of(list->names[i], name)) continue;
        if (found < list->count) return list->count;
        found = i;
    }
    return found;
}

/** Adds the pair of two names, one of which may be NULL, and takes them out of their lists. */
static bool add_pair(const char *const folder[2], char **first, char **second, const qm_check_rule *rule,
                     qm_check_list *list)
{
    char *path[2] = {first ? join(folder[0], *first) : NULL, second ? join(folder[1], *second) : NULL};
    const char *name = first ? *first : *second;
    bool is_added =
        (path[0] || !first) && (path[1] || !second) && qm_check_list_add(list, name, path[0], path[1], rule);
    for (int i = 0; i < 2; i++) {
        char **taken = i == 0 ? first : second;
        if (taken) {
            free(*taken);
            *taken = NULL;
        }
        free(path[i]);
    }
    return is_added;
}

/** Pairs files of equal names; then those that differ in their format alone, where there is one on each side; the rest
 * stays alone. */
static bool pair_names(const char *const folder[2], name_list names[2], const qm_check_rule *rule,
                       qm_check_list *list)
{
    bool is_complete = true;
    for (size_t i = 0, k = 0; is_complete && i < names[0].count && k < names[1].count;) {
        int order = strcmp(names[0].names[i], names[1].names[k]);
        if (order == 0) is_complete = add_pair(folder, &names[0].names[i], &names[1].names[k], rule, list);
        i += order <= 0;
        k += order >= 0;
    }
    for (size_t i = 0; is_complete && i < names[0].count; i++) {
        if (!names[0].names[i]) continue;
        size_t k = find_stem(&names[1], names[0].names[i]);
        if (k < names[1].count && find_stem(&names[0], names[1].names[k]) == i)
            is_complete = add_pair(folder, &names[0].names[i], &names[1].names[k], rule, list);
    }
    for (int side = 0; side < 2; side++)
        for (size_t i = 0; is_complete && i < names[side].count; i++) {
            char **name = &names[side].names[i];
            if (*name)
                is_complete = add_pair(folder, side == 0 ? name : NULL, side == 1 ? name : NULL, rule, list);
        }
    return is_complete;
}

static bool find_in_folders(const char *const folder[2], const qm_check_rule *rule, qm_check_list *list)
{
    name_list names[2] = {{0}};
    bool is_complete = true;
    for (int side = 0; is_complete && side < 2; side++) {
        is_complete = list_folder(folder[side], "", 0, &names[side]);
        if (names[side].count > 0) qsort(names[side].names, names[side].count, sizeof(char *), compare_names);
    }
    if (is_complete) {
        is_complete = pair_names(folder, names, rule, list);
        if (!is_complete) cli_print_problem(folder[0], NAN, NAN, "out of memory for the pairs");
    }
    reset_names(&names[0]);
    reset_names(&names[1]);
    if (is_complete && list->count == 0) {
        cli_print_problem(folder[0], NAN, NAN, "neither folder holds a mesh");
        is_complete = false;
    }
    return is_complete;
}

/* ---- all kinds ---- */

static bool read_manifest(const char *path, const qm_check_rule *rule, qm_check_list *list)
{
    size_t size;
    qm_problem problem;
    if (qm_format_from_path(path) != QM_FORMAT_UNKNOWN || is_folder(path)) {
        cli_print_problem(path, NAN, NAN,
                          "is no manifest in JSON, and without one check takes a NEW and a GOLDEN");
        return false;
    }
    uint8_t *bytes = cli_read_file(path, &size, false);
    char *folder = strndup(path, (size_t)(cli_base_name(path) - path));
    bool is_read = bytes && folder && qm_checks_read((const char *)bytes, size, folder, rule, list, &problem);
    if (bytes && folder && !is_read) cli_report(path, &problem, false);
    free(bytes);
    free(folder);
    return is_read;
}

bool cli_find_checks(const char *const path[2], const qm_check_rule *rule, qm_check_list *list)
{
    if (!path[1]) return read_manifest(path[0], rule, list);
    bool first = is_folder(path[0]), second = is_folder(path[1]);
    if (first && second) return find_in_folders(path, rule, list);
    if (first || second) {
        cli_print_problem(path[first ? 0 : 1], NAN, NAN, "is a folder, and the other path is not");
        return false;
    }
    if (qm_check_list_add(list, path[0], path[0], path[1], rule)) return true;
    cli_print_problem(path[0], NAN, NAN, "out of memory for the pair");
    return false;
}
