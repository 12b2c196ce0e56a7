/**
 * media.h: media types, as Content-Type and Accept headers name them (RFC 9110, 8.3 and 12.5.1).
 */
#ifndef QM_MEDIA_H
#define QM_MEDIA_H

#include <stdbool.h>

/** True when a Content-Type names this type, whatever its parameters and letter case. */
bool qm_media_is(const char *content_type, const char *type);

/**
 * The offer that an Accept header likes best, by its weights; among equals the one that it names most
 * closely, then the first. A type that has weight 0, or that nothing matches, is not taken.
 *
 * accept  NULL, or one without a word, takes everything
 * offers  media types without parameters, NULL-ended
 *
 * Returns the index of the offer, or -1 when none is taken.
 */
int qm_media_choose(const char *accept, const char *const *offers);

#endif
