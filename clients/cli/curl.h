/**
 * curl.h: libcurl, loaded when a daemon is to be asked. With its thirty libraries it takes longer to start
 * than most questions take to be answered, and a question that is answered here needs none of it.
 */
#ifndef CLI_CURL_H
#define CLI_CURL_H

#include <curl/curl.h>

/** What is used of it, without the prefix curl_. */
#define CLI_CURL_MAP(XX)                                                                                     \
    XX(global_init)                                                                                          \
    XX(global_cleanup)                                                                                       \
    XX(easy_init)                                                                                            \
    XX(easy_cleanup)                                                                                         \
    XX(easy_reset)                                                                                           \
    XX(easy_setopt)                                                                                          \
    XX(easy_getinfo)                                                                                         \
    XX(easy_perform)                                                                                         \
    XX(easy_escape)                                                                                          \
    XX(easy_strerror)                                                                                        \
    XX(slist_append)                                                                                         \
    XX(slist_free_all)                                                                                       \
    XX(free)

typedef struct cli_curl {
#define XX(name) __typeof__(curl_##name) *name;
    CLI_CURL_MAP(XX)
#undef XX
} cli_curl;

/** The library, which stays loaded; NULL when it cannot be, and *why then tells in words. One thread. */
const cli_curl *cli_curl_load(const char **why);

#endif
