/* SPDX-License-Identifier: GPL-2.0-or-later */
/* At the start: repair this instance's files that a power failure has truncated, at idle priority. */
#include "mender.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "recover.h"
#include "logger_state.h"

#define IDLE_PRIORITY (3 << 13) /* ioprio_set(): the disk when no other program uses it */

static bool is_ours(const struct logger *logger, const char *name) {
    size_t length = strlen(logger->program.instance), all = strlen(name);

    return !strncmp(name, logger->program.instance, length) && name[length] == '-' && all > 5 &&
           !strcmp(name + all - 5, ".mcap");
}

void *mender_run(void *argument) {
    struct logger *logger = argument;

    program_thread_signals();
    program_thread_ordinary();
    /* Both affect only this thread. */
    setpriority(PRIO_PROCESS, (id_t)syscall(SYS_gettid), 19);
    syscall(SYS_ioprio_set, 1, 0, IDLE_PRIORITY);
    DIR *folder = opendir(logger->config.folder);
    struct dirent *entry;
    while (folder && !logger->stopping && (entry = readdir(folder))) {
        char path[PATH_MAX], error[MCAP_ERROR_MAX];
        struct recovery recovery;

        if (!is_ours(logger, entry->d_name) ||
            snprintf(path, sizeof path, "%s/%s", logger->config.folder, entry->d_name) >= (int)sizeof path)
            continue;
        int result = recover(path, &logger->stopping, &recovery, error);
        if (!result)
            say("%s: was truncated; repaired, %llu messages", path, (unsigned long long)recovery.messages);
        if (!result && mcap_refused_text(&recovery.state, error))
            say("%s: %s; the old file is kept as .damaged", path, error);
        if (result && result != -EALREADY && result != -EBUSY && result != -ECANCELED)
            say("%s: %s", path, error);
    }
    if (folder)
        closedir(folder);
    return NULL;
}
