#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "cli.h"

/** The folder that a path lies in, on malloc; NULL without memory. */
static char *folder_of(const char *path)
{
    size_t size = (size_t)(cli_base_name(path) - path);
    return size > 0 ? strndup(path, size) : strdup(".");
}

bool cli_check_writable(const char *path, bool as_json)
{
    if (strcmp(path, "-") == 0 || access(path, W_OK) == 0) return true;
    if (errno == ENOENT) {
        char *folder = folder_of(path);
        bool is_writable = folder && access(folder, W_OK | X_OK) == 0;
        free(folder);
        if (is_writable) return true;
    }
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_UNAVAILABLE, "cannot be written: %s", strerror(errno ? errno : ENOMEM));
    cli_complain(path, &problem, as_json);
    return false;
}
