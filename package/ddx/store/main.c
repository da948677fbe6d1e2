/* SPDX-License-Identifier: GPL-2.0-or-later */
/* store: naming service and memory budget for items in shared memory. */
#include <errno.h>
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/un.h>
#include <unistd.h>

#include "../program/descriptors.h"
#include "files.h"
#include "../program/version.h"
#include "holder.h"
#include "checkpoint.h"
#include "listen.h"
#include "log.h"
#include "worker.h"

static struct settings settings = {.port = DDX_STORE_PORT, .budget = (uint64_t)8 << 20};

static const char usage[] = "usage: store [-m SIZE] [-port N]\n"
                            "\n"
                            "Keeps the names of items in shared memory, and their memory.\n"
                            "\n"
                            "  -m SIZE    memory for all items together, for example 8M (the default), 512K, 1G\n"
                            "  -port N    number of this store, if several run on one machine; default 2005\n"
                            "  -help      this text; -version\n"
                            "\n"
                            "The store runs until it gets TERM or INT; USR1 prints one line of JSON.\n";

static bool parse_size(const char *text, uint64_t *bytes) {
    char *end;

    errno = 0;
    unsigned long long value = strtoull(text, &end, 10);
    unsigned shift = 0;
    switch (*end) {
    case 'k':
    case 'K': shift = 10; break;
    case 'm':
    case 'M': shift = 20; break;
    case 'g':
    case 'G': shift = 30; break;
    default: break;
    }
    if (shift)
        end++;
    if (errno || end == text || *end || *text == '-' || !value || value > (UINT64_MAX >> 1) >> shift)
        return false;
    *bytes = (uint64_t)value << shift;
    return true;
}

/* 0 if the text is not a port. */
static int parse_port(const char *text) {
    char *end;
    unsigned long port = strtoul(text, &end, 10);

    return *text >= '0' && *text <= '9' && !*end && port <= 65535 ? (int)port : 0;
}

/* 0: continue; else the exit status plus one. */
static int parse_options(int argc, char **argv) {
    static const struct option options[] = {{"m", required_argument, NULL, 'm'},
                                            {"port", required_argument, NULL, 'p'},
                                            {"help", no_argument, NULL, 'h'},
                                            {"version", no_argument, NULL, 'v'},
                                            {NULL, 0, NULL, 0}};
    int option;

    opterr = 0;
    while ((option = getopt_long_only(argc, argv, ":", options, NULL)) != -1) {
        switch (option) {
        case 'm':
            if (!parse_size(optarg, &settings.budget)) {
                log_line("-m %s: not a size; give a number with K, M or G, for example -m 8M", optarg);
                return 3;
            }
            break;
        case 'p':
            settings.port = parse_port(optarg);
            if (!settings.port) {
                log_line("-port %s: not a port; give a number from 1 to 65535", optarg);
                return 3;
            }
            break;
        case 'h': fputs(usage, stdout); return 1;
        case 'v': version_print("store"); return 1;
        case ':': log_line("%s: needs a value; see store -help", argv[optind - 1]); return 3;
        default: log_line("%s: unknown option; see store -help", argv[optind - 1]); return 3;
        }
    }
    if (optind < argc) {
        log_line("%s: unexpected; see store -help", argv[optind]);
        return 3;
    }
    return 0;
}

/* One descriptor is needed for each frame, reader and handle: the usual limit of 1024 is soon reached. */
static void allow_descriptors(void) {
    struct rlimit limit;

    if (!getrlimit(RLIMIT_NOFILE, &limit)) {
        limit.rlim_cur = limit.rlim_max;
        setrlimit(RLIMIT_NOFILE, &limit);
    }
}

static int work(void) {
    return worker_run(&settings);
}

int main(int argc, char **argv) {
    descriptors_open();
    char path[sizeof(((struct sockaddr_un *)0)->sun_path)];
    int done = parse_options(argc, argv);

    if (done)
        return done - 1;
    allow_descriptors();
    settings.listener = listen_on(settings.port, path, sizeof path, &settings.restarted);
    if (settings.listener == -EADDRINUSE) {
        log_line("a store runs at port %d already; stop it, or give another -port", settings.port);
        return 1;
    }
    if (settings.listener < 0) {
        log_line("%s: %s", path, strerror(-settings.listener));
        return 1;
    }
    signal(SIGPIPE, SIG_IGN);
    if (checkpoint_begin()) {
        log_line("no memory");
        return 1;
    }
    files_begin();
    log_line("%llu bytes at %s", (unsigned long long)settings.budget, path);
    return holder_run(work);
}
