/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * appsrc ! shmsink, and shmsrc ! appsink. Zero copy: the writer asks shmsink for memory, as an element of GStreamer
 * would, and readers map the same memory. Copying: shmsink copies what comes from elsewhere, the reader copies it out.
 */
#include <gst/app/gstappsink.h>
#include <gst/app/gstappsrc.h>
#include <gst/gst.h>
#include <semaphore.h>
#include <stdint.h>
#include <string.h>

#include "peer.h"

static GstElement *pipeline, *source, *sink;
static GstAllocator *allocator;
static GstBuffer *loaned;
static GstMapInfo map;
static sem_t taken;
static size_t bytes;
static void *own; /* NULL: no copying */

static int failed(const char *what) {
    g_printerr("gstreamer: %s\n", what);
    return 1;
}

static int find_allocator(GstCaps *caps) {
    GstQuery *query = gst_query_new_allocation(caps, TRUE);
    GstPad *pad = gst_element_get_static_pad(source, "src");

    if (!gst_pad_peer_query(pad, query) || !gst_query_get_n_allocation_params(query))
        return failed("shmsink offers no memory");
    gst_query_parse_nth_allocation_param(query, 0, &allocator, NULL);
    gst_object_unref(pad);
    gst_query_unref(query);
    return allocator ? 0 : failed("shmsink offers no allocator");
}

int peer_open(const struct peer_setup *setup, bool writer) {
    char *text;

    gst_init(NULL, NULL);
    sem_init(&taken, 0, 0);
    bytes = setup->bytes;
    own = setup->mode == PEER_COPY ? setup->own : NULL;
    if (writer)
        text = g_strdup_printf("appsrc name=source format=time max-bytes=0 ! "
                               "shmsink socket-path=%s.gst wait-for-connection=false sync=false async=false "
                               "enable-last-sample=false",
                               setup->name);
    else
        text = g_strdup_printf("shmsrc socket-path=%s.gst is-live=true ! appsink name=sink sync=false", setup->name);
    pipeline = gst_parse_launch(text, NULL);
    if (!pipeline)
        return failed(text);
    source = gst_bin_get_by_name(GST_BIN(pipeline), "source");
    sink = gst_bin_get_by_name(GST_BIN(pipeline), "sink");
    if (gst_element_set_state(pipeline, GST_STATE_PLAYING) == GST_STATE_CHANGE_FAILURE ||
        gst_element_get_state(pipeline, NULL, NULL, 5 * GST_SECOND) == GST_STATE_CHANGE_FAILURE)
        return failed("does not play");
    if (!writer)
        return 0;
    GstCaps *caps = gst_caps_new_simple("application/x-frame", NULL, NULL);
    gst_app_src_set_caps(GST_APP_SRC(source), caps);
    return own ? 0 : find_allocator(caps);
}

void *peer_loan(void) {
    loaned = gst_buffer_new_allocate(allocator, bytes, NULL);
    if (!loaned || gst_buffer_peek_memory(loaned, 0)->allocator != allocator) {
        failed("shmsink's memory is used up");
        return NULL;
    }
    return gst_buffer_map(loaned, &map, GST_MAP_WRITE) ? map.data : NULL;
}

int peer_publish(void) {
    gst_buffer_unmap(loaned, &map);
    return gst_app_src_push_buffer(GST_APP_SRC(source), loaned) == GST_FLOW_OK ? 0 : failed("push");
}

int peer_write(const void *data) {
    /* Wrapped, not copied: shmsink copies it into shared memory, once, in a thread of its own. */
    GstBuffer *buffer = gst_buffer_new_wrapped_full(GST_MEMORY_FLAG_READONLY, (void *)(uintptr_t)data, bytes, 0, bytes,
                                                    &taken, (GDestroyNotify)(void (*)(void))sem_post);

    if (gst_app_src_push_buffer(GST_APP_SRC(source), buffer) != GST_FLOW_OK)
        return failed("push");
    while (sem_wait(&taken))
        ;
    return 0;
}

int peer_receive(void (*deliver)(const void *data)) {
    GstSample *sample = gst_app_sink_try_pull_sample(GST_APP_SINK(sink), 100 * GST_MSECOND);
    GstMapInfo seen;

    if (!sample)
        return 0;
    GstBuffer *buffer = gst_sample_get_buffer(sample);
    if (!gst_buffer_map(buffer, &seen, GST_MAP_READ))
        return failed("map");
    if (seen.size == bytes)
        deliver(own ? memcpy(own, seen.data, bytes) : seen.data);
    gst_buffer_unmap(buffer, &seen);
    gst_sample_unref(sample);
    return 0;
}

void peer_close(void) {
    gst_element_set_state(pipeline, GST_STATE_NULL);
}
