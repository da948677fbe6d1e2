/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "encode_load.h"

#include <pthread.h>
#include <time.h>

#include "ddx_time.h"
#include "program.h"

int64_t encode_load_now(void) {
    struct timespec spent;

    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &spent);
    return (int64_t)spent.tv_sec * SECOND + spent.tv_nsec;
}

void encode_load_measure(struct encode_load *load) {
    uint64_t spent = load->spent;
    int64_t now = ddx_time_now(), passed = now - load->time_at[load->at];

    /* Less than ENCODE_LOAD_SECONDS after the start, it counts as if nothing had been encoded before. */
    if (passed > 0)
        load->percent = (unsigned)((spent - load->spent_at[load->at]) * 100 / (uint64_t)passed);
    load->spent_at[load->at] = spent;
    load->time_at[load->at] = now;
    load->at = (load->at + 1) % ENCODE_LOAD_SECONDS;
}

static void set_priority(int policy, int priority) {
    const struct sched_param parameter = {.sched_priority = priority};

    pthread_setschedparam(pthread_self(), policy, &parameter);
}

void encode_load_yield(struct encode_load *load) {
    bool ordinary = load->percent > ENCODE_LOAD_MOST;

    if (!load->lowered) {
        struct sched_param parameter;

        load->lowered = true;
        if (pthread_getschedparam(pthread_self(), &load->policy, &parameter))
            return;
        load->priority = parameter.sched_priority > 1 ? parameter.sched_priority - 1 : parameter.sched_priority;
        set_priority(load->policy, load->priority);
    }
    if (!load->priority || ordinary == load->ordinary)
        return;
    load->ordinary = ordinary;
    if (ordinary)
        program_thread_ordinary();
    else
        set_priority(load->policy, load->priority);
}
