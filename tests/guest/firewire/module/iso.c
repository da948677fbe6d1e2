// SPDX-License-Identifier: GPL-2.0
/*
 * Isochronous reception, packet by packet into an application's buffers, like an OHCI controller: a buffer that waits
 * for the start of a frame skips packets, and packets without a buffer are lost.
 */
#include <linux/highmem.h>
#include <linux/slab.h>

#include "vfirewire.h"

/* Buffers for `count` packets of `size` bytes. */
struct entry {
    struct list_head link;
    struct fw_iso_buffer *buffer;
    unsigned long offset;
    unsigned int size, count, filled;
    bool wait, interrupt;
    u32 timestamp;
    __be32 header[];
};

struct context {
    struct fw_iso_context base;
    struct list_head link; /* in vf_bus.contexts while receiving */
    struct list_head queued, done;
    u32 sync, tags;
    void *header; /* one page */
    size_t header_length;
    u32 timestamp;
};

static struct context *context_of(struct fw_iso_context *base) {
    return container_of(base, struct context, base);
}

/* Bytes 0 to 3 of a frame are its number; the rest depends on camera, number and position. */
static u8 pixel(const struct vf_packet *packet, unsigned int place) {
    if (place < 4)
        return packet->number >> (24 - 8 * place);
    return packet->number * 7 + packet->camera * 31 + place + (place >> 8);
}

static void copy(const struct vf_packet *packet, const struct entry *entry) {
    unsigned long to = entry->offset + entry->filled * entry->size;
    unsigned int i, length = min(packet->length, entry->size);

    for (i = 0; i < length;) {
        struct page *page = entry->buffer->pages[(to + i) >> PAGE_SHIFT];
        unsigned int end = min(length, i + (unsigned int)(PAGE_SIZE - offset_in_page(to + i)));
        u8 *bytes = kmap_local_page(page);

        for (; i < end; i++)
            bytes[offset_in_page(to + i)] = pixel(packet, packet->offset + i);
        kunmap_local(bytes);
    }
}

static void note_header(const struct vf_packet *packet, struct entry *entry, size_t header_size) {
    __be32 *header = entry->header + entry->filled * header_size / 4;

    entry->timestamp = vf_timestamp(packet->cycle);
    header[0] = cpu_to_be32(packet->length << 16 | packet->channel << 8 | TCODE_STREAM_DATA << 4 | packet->sy);
    if (header_size > 4)
        header[1] = cpu_to_be32(entry->timestamp);
}

static void receive(struct context *context, const struct vf_packet *packet) {
    struct entry *entry = list_first_entry_or_null(&context->queued, struct entry, link);

    if (!entry || (entry->wait && !entry->filled && packet->sy != context->sync))
        return;
    copy(packet, entry);
    note_header(packet, entry, context->base.header_size);
    if (++entry->filled < entry->count)
        return;
    list_move_tail(&entry->link, &context->done);
    if (entry->interrupt)
        queue_work(vf_bus.card.isoc_wq, &context->base.work);
}

void vf_iso_receive(const struct vf_packet *packet) {
    struct context *context;

    guard(spinlock_irqsave)(&vf_bus.lock);
    list_for_each_entry(context, &vf_bus.contexts, link) if (context->base.channel == packet->channel &&
                                                             context->tags & 1) receive(context, packet);
}

static void report(struct context *context) {
    context->base.callback.sc(&context->base, context->timestamp, context->header_length, context->header,
                              context->base.callback_data);
    context->header_length = 0;
}

static void add_headers(struct context *context, const struct entry *entry) {
    size_t size = context->base.header_size;
    unsigned int i;

    for (i = 0; i < entry->count; i++) {
        if (context->header_length + size > PAGE_SIZE) {
            if (context->base.drop_overflow_headers)
                return;
            report(context);
        }
        memcpy(context->header + context->header_length, (u8 *)entry->header + i * size, size);
        context->timestamp = entry->timestamp;
        context->header_length += size;
    }
}

static struct entry *take_done(struct context *context) {
    struct entry *entry;

    guard(spinlock_irqsave)(&vf_bus.lock);
    entry = list_first_entry_or_null(&context->done, struct entry, link);
    if (entry)
        list_del(&entry->link);
    return entry;
}

static void complete_entries(struct context *context) {
    struct entry *entry;

    while ((entry = take_done(context))) {
        add_headers(context, entry);
        if (entry->interrupt)
            report(context);
        kfree(entry);
    }
}

static void work(struct work_struct *work) {
    complete_entries(context_of(container_of(work, struct fw_iso_context, work)));
}

int vf_iso_flush_completions(struct fw_iso_context *base) {
    struct context *context = context_of(base);

    complete_entries(context);
    if (context->header_length)
        report(context);
    return 0;
}

struct fw_iso_context *vf_iso_allocate(struct fw_card *card, int type, int channel, size_t header_size) {
    struct context *context;

    if (type != FW_ISO_CONTEXT_RECEIVE || header_size > 8)
        return ERR_PTR(-EOPNOTSUPP);
    context = kzalloc(sizeof(*context), GFP_KERNEL);
    if (!context)
        return ERR_PTR(-ENOMEM);
    context->header = (void *)__get_free_page(GFP_KERNEL);
    if (!context->header) {
        kfree(context);
        return ERR_PTR(-ENOMEM);
    }
    INIT_LIST_HEAD(&context->link);
    INIT_LIST_HEAD(&context->queued);
    INIT_LIST_HEAD(&context->done);
    INIT_WORK(&context->base.work, work);
    return &context->base;
}

void vf_iso_free(struct fw_iso_context *base) {
    struct context *context = context_of(base);
    struct entry *entry, *next;

    vf_iso_stop(base);
    cancel_work_sync(&base->work);
    list_splice_init(&context->queued, &context->done);
    list_for_each_entry_safe(entry, next, &context->done, link) kfree(entry);
    free_page((unsigned long)context->header);
    kfree(context);
}

int vf_iso_start(struct fw_iso_context *base, s32 cycle, u32 sync, u32 tags) {
    struct context *context = context_of(base);

    guard(spinlock_irqsave)(&vf_bus.lock);
    if (list_empty(&context->queued))
        return -ENODATA;
    context->sync = sync;
    context->tags = tags;
    list_move_tail(&context->link, &vf_bus.contexts);
    return 0;
}

int vf_iso_stop(struct fw_iso_context *base) {
    guard(spinlock_irqsave)(&vf_bus.lock);
    list_del_init(&context_of(base)->link);
    return 0;
}

int vf_iso_set_channels(struct fw_iso_context *base, u64 *channels) {
    return -EINVAL;
}

int vf_iso_queue(struct fw_iso_context *base, struct fw_iso_packet *packet, struct fw_iso_buffer *buffer,
                 unsigned long payload) {
    struct entry *entry = kzalloc(struct_size(entry, header, packet->header_length / 4), GFP_KERNEL);

    if (!entry)
        return -ENOMEM;
    entry->buffer = buffer;
    entry->offset = payload;
    entry->count = packet->header_length / base->header_size;
    entry->size = packet->payload_length / entry->count;
    entry->wait = packet->skip;
    entry->interrupt = packet->interrupt;
    guard(spinlock_irqsave)(&vf_bus.lock);
    list_add_tail(&entry->link, &context_of(base)->queued);
    return 0;
}

void vf_iso_flush_queue(struct fw_iso_context *base) {}
