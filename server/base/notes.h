/**
 * notes.h: what people know of a mesh besides its file: the unit of its coordinates, and how far the true surface may be
 * from it.
 */
#ifndef QM_NOTES_H
#define QM_NOTES_H

#include <stdbool.h>

#define QM_UNIT_SIZE 4

typedef struct qm_notes {
    char unit[QM_UNIT_SIZE]; /* one of qm_notes_units, or "" when it is not known */
    double
        uncertainty; /* the Hausdorff distance to the true surface is at most this, in the unit; 0: it is the mesh */
} qm_notes;

/** The units, with NULL after the last: micrometre, millimetre, centimetre, metre, inch, foot. */
extern const char *const qm_notes_units[];
#define QM_NOTES_UNITS "um, mm, cm, m, in or ft"

/** Sets a unit by its name; false, and no unit, for any other text. */
bool qm_notes_set_unit(qm_notes *notes, const char *name);

/** A number of 0 or more from all of a text; false for another text. */
bool qm_notes_set_uncertainty(qm_notes *notes, const char *text);

#endif
