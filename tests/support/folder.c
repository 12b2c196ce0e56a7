#include "folder.h"

#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OPEN_FOLDERS = 16 };

static size_t file_count;

char *qm_folder_make(void)
{
    char *path = strdup("/tmp/quadmesh-test-XXXXXX");
    if (path && mkdtemp(path)) return path;
    perror("a folder for the test");
    exit(1);
}

static int remove_entry(const char *path, const struct stat *facts, int type, struct FTW *place)
{
    (void)facts;
    (void)type;
    (void)place;
    return remove(path);
}

void qm_folder_remove(char *path)
{
    nftw(path, remove_entry, OPEN_FOLDERS, FTW_DEPTH | FTW_PHYS);
    free(path);
}

static int count_entry(const char *path, const struct stat *facts, int type, struct FTW *place)
{
    (void)path;
    (void)facts;
    (void)place;
    if (type == FTW_F) file_count++;
    return 0;
}

size_t qm_folder_count_files(const char *path)
{
    file_count = 0;
    nftw(path, count_entry, OPEN_FOLDERS, FTW_PHYS);
    return file_count;
}
