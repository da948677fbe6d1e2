/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Fuzz target: an MCAP file, its contents, and the types of its channels. */
#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "form.h"
#include "mcap.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void read_types(const struct mcap_reader *reader) {
    for (unsigned id = 0; id < 256; id++) {
        const struct mcap_channel *channel = mcap_channel(reader, (uint16_t)id);
        const char *declaration = channel ? mcap_value(channel, "ddx.declaration") : NULL;
        const char *extents = channel ? mcap_value(channel, "ddx.extents") : NULL;
        struct form *form;
        if (declaration && !form_of_text("T", declaration, extents ? extents : "", &form)) {
            struct form *again;
            assert(form->message_size > FORM_HEADER);
            assert(!form_of_text("T", form->declaration, form->extents, &again));
            assert(again->message_size == form->message_size);
            form_free(again);
            form_free(form);
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char path[32], error[MCAP_ERROR_MAX] = "";
    int fd = memfd_create("mcap", MFD_CLOEXEC);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size)
        abort();
    snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
    struct mcap_reader *reader = mcap_open(path, error);
    if (reader) {
        struct mcap_message message;
        uint64_t first, last, before = 0;
        unsigned sum = 0;
        mcap_times(reader, &first, &last);
        while (mcap_next(reader, &message) > 0) {
            for (size_t i = 0; i < message.size; i++)
                sum += message.data[i];
            before = message.log_time;
        }
        assert(before <= UINT64_MAX && sum <= UINT32_MAX);
        read_types(reader);
    } else {
        assert(*error);
    }
    mcap_close(reader);
    close(fd);
    return 0;
}
