/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "counters.h"

#include <inttypes.h>
#include <string.h>

#include "program.h"

#define SUFFIX ".packets"

void counters_open(struct counters *counters, DDX_STORE_ID *id) {
    char name[DDX_NAME_MAX + 1], text[1024];
    struct ddx_item_spec spec = {.name = name, .type = "DDX_PACKETS", .declaration = text};

    if (!id || snprintf(name, sizeof name, "%s" SUFFIX, counters->instance) >= (int)sizeof name)
        return;
    int length = snprintf(text, sizeof text, "struct { ");
    for (unsigned i = 0; i < counters->count; i++)
        length += snprintf(text + length, sizeof text - (size_t)length, "uint64_t %s; ", counters->names[i]);
    strcpy(text + length, "}");
    program_does_without(counters->instance, SUFFIX, ddx_store_create(id, &spec, &counters->item));
    counters_write(counters);
}

void counters_write(struct counters *counters) {
    void *data;

    if (!counters->item || ddx_store_loan(counters->item, &data))
        return;
    memcpy(data, counters->values, counters->count * sizeof *counters->values);
    ddx_store_publish(counters->item, NULL);
}

void counters_print(const struct counters *counters, FILE *file) {
    fprintf(file, "{\"instance\":\"%s" SUFFIX "\"", counters->instance);
    for (unsigned i = 0; i < counters->count; i++)
        fprintf(file, ",\"%s\":%" PRIu64, counters->names[i], counters->values[i]);
    fputs("}\n", file);
    fflush(file);
}

void counters_close(struct counters *counters) {
    ddx_store_done_item(counters->item);
    counters->item = NULL;
}
