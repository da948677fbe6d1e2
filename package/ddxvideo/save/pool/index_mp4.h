/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The table of a pool's MP4 file, which follows from block 0 and the index alone. Recorder, recovery and verification
 * make it here, so that it has the same bytes.
 */
#ifndef DDXVIDEO_INDEX_MP4_H
#define DDXVIDEO_INDEX_MP4_H

#include "mp4_write.h"
#include "pool_files.h"

/* The index's first frames, for mp4_table(); the caller frees them. NULL: no memory, or not entries of fragments. */
struct mp4_entry *index_mp4_entries(const struct index_file *index, uint32_t frames);

/*
 * Finish a file after index_end(), which counted its frames: as mp4_finish(), and set header.bytes to those of the
 * whole file. Until the header is on the disk, the file counts as unfinished. 0; -EBADMSG: block 0 is damaged; or
 * -errno. For any other file than one of INDEX_MP4, 0 and nothing is done.
 */
int index_mp4_finish(struct pool_file *file, struct index_file *index);

#endif
