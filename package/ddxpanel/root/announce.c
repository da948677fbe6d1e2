/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "announce.h"

#include <errno.h>
#include <ifaddrs.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <netinet/in.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include "clock.h"

/* The addresses of this machine, and their changes. The sum is FNV-1a, 64 bits. */
#define SUM_BEGIN 0xcbf29ce484222325u
#define SUM_PRIME 0x100000001b3u

/* A socket that is readable after the kernel has changed addresses or interfaces; or -errno. */
static int address_watch(void) {
    const struct sockaddr_nl groups = {.nl_family = AF_NETLINK,
                                       .nl_groups = RTMGRP_LINK | RTMGRP_IPV4_IFADDR | RTMGRP_IPV6_IFADDR};
    int fd = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, NETLINK_ROUTE);

    if (fd < 0)
        return -errno;
    if (!bind(fd, (const struct sockaddr *)&groups, sizeof groups))
        return fd;
    int error = -errno;
    close(fd);
    return error;
}

/* Forget the changes that wait at the socket. What they were is not read: address_sum() looks itself. */
static void address_forget(int watch) {
    char some[64];

    /* ENOBUFS: more changes than the socket had room for, which is a change, too. */
    while (recv(watch, some, sizeof some, MSG_TRUNC) > 0 || errno == ENOBUFS || errno == EINTR)
        errno = 0;
}

static uint64_t add(uint64_t sum, const void *bytes, size_t size) {
    for (const unsigned char *byte = bytes; size; size--)
        sum = (sum ^ *byte++) * SUM_PRIME;
    return sum;
}

/*
 * A number for the present set of addresses, with their interfaces: another set has another one. 0: there are none but
 * those of the loopback and of interfaces that are down.
 */
static uint64_t address_sum(void) {
    struct ifaddrs *all;
    uint64_t sum = 0;

    if (getifaddrs(&all))
        return 0;
    for (const struct ifaddrs *one = all; one; one = one->ifa_next) {
        if (!one->ifa_addr || (one->ifa_flags & IFF_LOOPBACK) || !(one->ifa_flags & IFF_UP))
            continue;
        uint64_t own = add(SUM_BEGIN, one->ifa_name, strlen(one->ifa_name));
        if (one->ifa_addr->sa_family == AF_INET)
            sum += add(own, &((const struct sockaddr_in *)(const void *)one->ifa_addr)->sin_addr, 4);
        else if (one->ifa_addr->sa_family == AF_INET6)
            sum += add(own, &((const struct sockaddr_in6 *)(const void *)one->ifa_addr)->sin6_addr, 16);
    }
    freeifaddrs(all);
    return sum;
}

#define SETTLE 1000     /* ms: changes come together, the address of each kind by itself */
#define PAUSE 1000      /* ms before mdnsd is started again, the first time, then twice as long */
#define PAUSE_MAX 60000 /* ms; also the time after which mdnsd counts as stable again */
#define MS_S 1000
#define NS_MS 1000000

/* Unless a look is due earlier already: a change each 0.9 s must not put it off for ever. */
static void look_in(struct announce *announce, int64_t ms) {
    struct itimerspec due = {.it_value = {ms / MS_S, ms % MS_S * NS_MS + 1}}, now;
    int64_t left = timerfd_gettime(announce->timer, &now)
                       ? 0
                       : now.it_value.tv_sec * MS_S + (now.it_value.tv_nsec + NS_MS - 1) / NS_MS;

    if (!left || left > ms)
        timerfd_settime(announce->timer, 0, &due, NULL);
}

static void follow(const struct announce *announce, int fd) {
    struct epoll_event event = {.events = EPOLLIN, .data.fd = fd};

    epoll_ctl(announce->events, EPOLL_CTL_ADD, fd, &event);
}

/* After it has exited or was killed. */
static void reap(struct announce *announce) {
    siginfo_t end;

    while (waitid(P_PIDFD, (id_t)announce->process, &end, WEXITED) < 0 && errno == EINTR)
        continue;
    close(announce->process); /* leaves the epoll set by that */
    announce->process = -1;
}

static void start(struct announce *announce) {
    announce->process = part_start(announce->mdnsd);
    announce->begin = clock_ms();
    if (announce->process >= 0) {
        follow(announce, announce->process);
        return;
    }
    fprintf(stderr, "ddxpanel: %s: %s\n", announce->mdnsd->name, strerror(-announce->process));
    announce->process = -1;
    look_in(announce, PAUSE_MAX);
}

/* As a child of init, which reaps it. */
static void show(const struct announce *announce) {
    char *const command[] = {(char *)announce->show, NULL};
    pid_t child = fork();

    if (!child) {
        if (!fork()) {
            setsid();
            close_range(3, ~0u, 0);
            execv(command[0], command);
        }
        _exit(0);
    }
    while (child > 0 && waitpid(child, NULL, 0) < 0 && errno == EINTR)
        continue;
}

/* The robot goes on without its name, so mdnsd's end is not that of the panel: any machine may have sent the packet. */
static void has_exited(struct announce *announce) {
    reap(announce);
    if (clock_ms() - announce->begin >= PAUSE_MAX)
        announce->pause = PAUSE;
    fprintf(stderr, "ddxpanel: %s has exited; it is started again in %d s\n", announce->mdnsd->name,
            (int)(announce->pause / MS_S));
    look_in(announce, announce->pause);
    announce->pause = announce->pause * 2 < PAUSE_MAX ? announce->pause * 2 : PAUSE_MAX;
}

static void look(struct announce *announce) {
    uint64_t addresses = address_sum(), before = announce->addresses;

    announce->addresses = addresses;
    if (addresses != before && announce->process >= 0) {
        syscall(SYS_pidfd_send_signal, announce->process, SIGKILL, NULL, 0);
        reap(announce);
    }
    if (addresses && announce->process < 0)
        start(announce);
    if (addresses && addresses != before)
        show(announce);
}

void announce_look(void *argument) {
    struct announce *announce = argument;
    struct epoll_event event;
    uint64_t count;

    while (epoll_wait(announce->events, &event, 1, 0) > 0) {
        if (event.data.fd == announce->watch) {
            address_forget(announce->watch);
            if (address_sum() != announce->addresses) /* routers renew addresses all the time */
                look_in(announce, SETTLE);
        } else if (event.data.fd == announce->process) {
            has_exited(announce);
        } else if (read(announce->timer, &count, sizeof count) == (ssize_t)sizeof count) {
            look(announce);
        }
    }
}

int announce_open(struct announce *announce, const struct part *mdnsd, const char *show) {
    *announce = (struct announce){.mdnsd = mdnsd, .show = show, .process = -1, .pause = PAUSE};
    announce->watch = address_watch();
    if (announce->watch < 0)
        return announce->watch;
    announce->timer = timerfd_create(CLOCK_BOOTTIME, TFD_CLOEXEC | TFD_NONBLOCK);
    if (announce->timer < 0)
        return -errno;
    announce->events = epoll_create1(EPOLL_CLOEXEC);
    if (announce->events < 0)
        return -errno;
    follow(announce, announce->watch);
    follow(announce, announce->timer);
    look_in(announce, 0); /* at the addresses of now */
    return announce->events;
}
