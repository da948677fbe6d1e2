/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The pool's files: names, headers, search. */
#ifndef DDXVIDEO_POOL_FILES_H
#define DDXVIDEO_POOL_FILES_H

#include <dirent.h>

#include "index.h"
#include "pool_state.h"

/* Names of a file and its index in the pool's folder. */
void pool_data_name(char name[POOL_PATH], long id);
void pool_index_name(char name[POOL_PATH], long id);

/*
 * The number in the name of a file or an index; pool_data_id(): of a file only. 0: the pool does not make such names,
 * so it is not a file of the pool.
 */
long pool_id(const char *name);
long pool_data_id(const char *name);

/* List a folder. NULL and errno on failure. */
DIR *pool_list(int folder);

/* Call `visit` with the number of each file, until it returns false. 0 or -errno. */
int pool_each(struct pool *pool, bool (*visit)(struct pool *pool, long id, void *argument), void *argument);

/* Whether the file is a recording with a name. It must not be overwritten. */
bool pool_is_named(const struct pool *pool, long id);

/* Read the header of an index. False if it has none, or an invalid one. */
bool pool_read_header(int fd, struct index_header *header);

/* Lock the file, open it and its index, and read `header`; INDEX_RAW stands for a damaged one, and for that of a
 * deleted recording. False if another program has the file, or on an error. */
bool pool_claim(struct pool *pool, long id, struct pool_file *file, struct index_header *header);

/* Claim an unused file in this state. False if there is none. */
bool pool_find(struct pool *pool, uint32_t state, struct pool_file *file);

/* Mark the file as free, with that number of bytes already written. */
void pool_forget(struct pool_file *file, struct index_header *header, uint64_t bytes);

/* Create a file and lock it; file and index are empty. */
int pool_create(struct pool *pool, struct pool_file *file);

/* Write the whole index, without entries. */
int pool_write_index(const struct pool_file *file, uint32_t state);

/* Allocate blocks for the whole file, in one piece if possible. Some file systems allocate them only on writing. */
int pool_allocate(const struct pool *pool, const struct pool_file *file);

/* Whether the disk has space for one more file and a reserve for other programs. */
bool pool_has_room(const struct pool *pool);

/* Write the header of the index, with its checksum. The caller syncs. */
int pool_write_header(const struct pool_file *file, struct index_header *header);

/* Close the file unchanged; the next program that opens the pool finishes it. */
void pool_release(struct pool_file *file);

/* Close the file as free: nothing was recorded. */
void pool_give_back(struct pool_file *file);

#endif
