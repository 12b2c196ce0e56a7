/**
 * origin.h: which web pages may talk to the daemon (WHATWG Fetch, CORS protocol; RFC 6454 for origins).
 */
#ifndef QM_ORIGIN_H
#define QM_ORIGIN_H

#include <stdbool.h>

/** True when a list of origins with commas or blanks between them names this one, or is "*". */
bool qm_origin_is_listed(const char *list, const char *origin);

/** True when an origin is that of a page which was loaded from this host ("name:port", as Host has it). */
bool qm_origin_is_host(const char *origin, const char *host);

/**
 * True for a Host that stands for this machine by its address or as localhost. Any other name may be one that
 * a strange page has made resolve to this machine, so that its browser takes the daemon for its own server.
 */
bool qm_origin_host_is_plain(const char *host);

#endif
