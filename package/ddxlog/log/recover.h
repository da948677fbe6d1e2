/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Repair of a truncated file: its whole chunks are copied into a file next to it, which replaces the old file once it
 * is complete and on the disk. Until then, and after any failure, the old file is unchanged.
 */
#ifndef DDXLOG_RECOVER_H
#define DDXLOG_RECOVER_H

#include <mcap.h>
#include <stdatomic.h>

struct recovery {
    uint64_t messages;
    struct mcap_state state; /* of the old file */
    bool kept; /* the old file is kept as FILE.damaged: chunks in its middle are damaged, or records are refused */
};

/*
 * 0; -EALREADY: the file is complete; -EBUSY: it is being written; -ECANCELED: *stop became true; other -errno. On
 * failures except -EBUSY, error[MCAP_ERROR_MAX] has a text.
 */
int recover(const char *path, const atomic_bool *stop, struct recovery *recovery, char *error);

#endif
