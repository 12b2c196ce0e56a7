/**
 * notes.c: the names of units, and notes from text.
 */
#include "notes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *const qm_notes_units[] = {"um", "mm", "cm", "m", "in", "ft", NULL};

bool qm_notes_set_unit(qm_notes *notes, const char *name)
{
    notes->unit[0] = '\0';
    for (int i = 0; qm_notes_units[i]; i++)
        if (strcmp(qm_notes_units[i], name) == 0) strcpy(notes->unit, name);
    return notes->unit[0] != '\0';
}

bool qm_notes_set_uncertainty(qm_notes *notes, const char *text)
{
    char *end;
    notes->uncertainty = strtod(text, &end);
    bool starts_well = (text[0] >= '0' && text[0] <= '9') || text[0] == '.';
    return starts_well && *end == '\0' && isfinite(notes->uncertainty) && notes->uncertainty >= 0.0;
}
