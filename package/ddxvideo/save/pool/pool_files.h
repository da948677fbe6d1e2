/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The files of the pool: names, headers, which are free. */
#ifndef DDXVIDEO_POOL_FILES_H
#define DDXVIDEO_POOL_FILES_H

#include <dirent.h>

#include "index.h"
#include "pool_state.h"

/* Names in the pool's folder. */
void pool_data_name(char name[POOL_PATH], long id);
void pool_index_name(char name[POOL_PATH], long id);

/*
 * The number of a file, or of its index, from its name there; pool_data_id() takes no index. 0: the name is none that
 * the pool makes, so the file is not one of the pool's.
 */
long pool_id(const char *name);
long pool_data_id(const char *name);

/* What is in a folder; NULL and errno. */
DIR *pool_list(int folder);

/* Call `visit` for the number of each file. It returns false to end the walk. 0 or -errno. */
int pool_each(struct pool *pool, bool (*visit)(struct pool *pool, long id, void *argument), void *argument);

/* Whether the file is a recording that has its name. It must not be recorded into. */
bool pool_is_named(const struct pool *pool, long id);

/* The header of an index; false if it has none, or a spoilt one. */
bool pool_read_header(int fd, struct index_header *header);

/* Lock the file and open both; false if another program has it, or on an error. `header` is the index's; a
 * damaged one is INDEX_RAW, and so is that of a deleted recording. */
bool pool_claim(struct pool *pool, long id, struct pool_file *file, struct index_header *header);

/* Claim an unused file in this state. False if there is none. */
bool pool_find(struct pool *pool, uint32_t state, struct pool_file *file);

/* Mark the recording in it, of that number of bytes, as free. */
void pool_forget(struct pool_file *file, struct index_header *header, uint64_t bytes);

/* A new file, ours; neither file nor index has any contents. */
int pool_create(struct pool *pool, struct pool_file *file);

/* All of the index: an empty one. */
int pool_write_index(const struct pool_file *file, uint32_t state);

/* Blocks for all of it, in one piece where the disk has one. A file system that cannot gives them as it is written. */
int pool_allocate(const struct pool *pool, const struct pool_file *file);

/* Whether the disk has space for one more file, and a reserve for other programs. */
bool pool_has_room(const struct pool *pool);

/* Header block of the index, in place, with its checksum. The caller syncs. */
int pool_write_header(const struct pool_file *file, struct index_header *header);

/* Close it unchanged; the next program that opens the pool finishes it. */
void pool_release(struct pool_file *file);

/* Nothing was recorded: the file is free. */
void pool_give_back(struct pool_file *file);

#endif
