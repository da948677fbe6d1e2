/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "backlog.h"

#include <string.h>

bool backlog_has_room(const struct backlog *backlog, const struct recording *present, uint64_t queue_bytes) {
    unsigned count = backlog->count + (present != NULL);
    uint64_t bytes = queue_bytes + (present ? recording_queue_bytes(present) : 0);

    for (unsigned i = 0; i < backlog->count; i++)
        bytes += recording_queue_bytes(backlog->recording[i]);
    return count <= 1 || (count < BACKLOG_MAX && bytes <= 2 * recording_queue_bytes_max());
}

void backlog_add(struct backlog *backlog, struct recording *recording) {
    backlog->recording[backlog->count++] = recording;
}

struct recording *backlog_take(struct backlog *backlog, bool wait) {
    if (!backlog->count || (!wait && !recording_is_on_disk(backlog->recording[0])))
        return NULL;
    struct recording *oldest = backlog->recording[0];
    backlog->count--;
    memmove(backlog->recording, backlog->recording + 1, backlog->count * sizeof backlog->recording[0]);
    return oldest;
}
