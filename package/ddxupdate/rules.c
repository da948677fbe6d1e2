/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "rules.h"

#include <stdlib.h>

#include "state.h"

static double number(const struct place *place, const char *name, double usual) {
    char text[WORD_MAX], *end;

    state_get(place->rules, name, text, sizeof text);
    const double value = strtod(text, &end);
    return *text && !*end && value > 0 && value < 1e6 ? value : usual;
}

void rules_read(struct rules *rules, const struct place *place) {
    *rules = (struct rules){.good = number(place, "good", 300),
                            .deadline = number(place, "deadline", 900),
                            .step = number(place, "step", 5),
                            .watchdog = (unsigned)number(place, "watchdog", 300),
                            .ssh = (unsigned)number(place, "ssh", 22)};
}
