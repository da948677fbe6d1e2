/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A file that was cut off gets its end: its whole chunks are copied into a file next to it, which replaces it when
 * it is complete and on the disk. Until then, and whenever something fails, the old one is untouched.
 */
#ifndef DDXLOG_RECOVER_H
#define DDXLOG_RECOVER_H

#include <mcap.h>
#include <stdatomic.h>

struct recovery {
    uint64_t messages;
    struct mcap_state state; /* of the old file */
    bool kept; /* chunks in its midst are damaged, or records are refused: it is kept as FILE.damaged */
};

/*
 * 0; -EALREADY: the file is complete; -EBUSY: it is being written; -ECANCELED: *stop became true; other -errno. But for
 * the first two, a text in error[MCAP_ERROR_MAX].
 */
int recover(const char *path, const atomic_bool *stop, struct recovery *recovery, char *error);

#endif
