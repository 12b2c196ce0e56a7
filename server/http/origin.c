/**
 * origin.c: hosts and origins.
 */
#include "origin.h"

#include <arpa/inet.h>
#include <string.h>
#include <strings.h>

#define SEPARATORS ", \t"

bool qm_origin_is_listed(const char *list, const char *origin)
{
    size_t length = strlen(origin);
    for (list += strspn(list, SEPARATORS); *list; list += strspn(list, SEPARATORS)) {
        size_t size = strcspn(list, SEPARATORS);
        if ((size == 1 && *list == '*') || (size == length && strncasecmp(list, origin, length) == 0))
            return true;
        list += size;
    }
    return false;
}

bool qm_origin_is_host(const char *origin, const char *host)
{
    const char *name = strstr(origin, "://");
    return name && host && strcasecmp(name + strlen("://"), host) == 0;
}

/** The name without its port, and without the brackets of an address of version 6; false when it is too
 * long. */
static bool copy_name(const char *host, char *out, size_t size)
{
    bool has_brackets = *host == '[';
    if (has_brackets) host++;
    size_t length = strcspn(host, has_brackets ? "]" : ":");
    if (length >= size || (has_brackets && host[length] != ']')) return false;
    memcpy(out, host, length);
    out[length] = '\0';
    return true;
}

bool qm_origin_host_is_plain(const char *host)
{
    char name[64];
    struct in6_addr address;
    if (!host || !*host) return true;
    if (!copy_name(host, name, sizeof name)) return false;
    return strcasecmp(name, "localhost") == 0 || inet_pton(AF_INET, name, &address) == 1 ||
           inet_pton(AF_INET6, name, &address) == 1;
}
