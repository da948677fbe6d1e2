// SPDX-License-Identifier: GPL-2.0
/* Asynchronous requests of the host to itself and to the cameras, answered before the function returns. */
#include "vfirewire.h"

#define MOST_BYTES 512

struct request {
    unsigned int tcode, extended, length;
    u64 offset;
    __be32 *data; /* of the request */
};

static struct request parse(struct fw_packet *packet) {
    struct request request = {
        .tcode = packet->header[0] >> 4 & 0xf,
        .offset = ((u64)packet->header[1] << 32 | packet->header[2]) & 0xffffffffffffULL,
        .length = 4,
        .data = (__be32 *)&packet->header[3],
    };

    if (request.tcode & 1) { /* a block */
        request.length = packet->header[3] >> 16;
        request.extended = packet->header[3] & 0xffff;
        request.data = packet->payload;
    }
    return request;
}

static void finish(struct fw_card *card, struct fw_packet *packet, int ack) {
    packet->ack = ack;
    packet->callback(packet, card, ack);
}

/* Build the answer first: the callback may free the packet. */
static void respond(struct fw_card *card, struct fw_packet *packet, int rcode, void *data, size_t length) {
    struct fw_packet response = {
        .speed = packet->speed,
        .generation = packet->generation,
        .timestamp = packet->timestamp,
        .ack = ACK_COMPLETE,
    };

    if (rcode != RCODE_COMPLETE)
        length = 0;
    fw_fill_response(&response, packet->header, rcode, length ? data : NULL, length);
    finish(card, packet, ACK_PENDING);
    fw_core_handle_response(card, &response);
}

/* The registers that an OHCI controller itself serves; firewire-core relies on that. */
static int lock_csr(const struct request *request, __be32 *old) {
    u32 *csr = &vf_bus.csr[(request->offset - CSR_REGISTER_BASE - CSR_BUS_MANAGER_ID) / 4];
    bool swap =
        request->tcode == TCODE_LOCK_REQUEST && request->extended == EXTCODE_COMPARE_SWAP && request->length == 8;

    if (!swap && request->tcode != TCODE_READ_QUADLET_REQUEST)
        return RCODE_TYPE_ERROR;
    guard(spinlock_irqsave)(&vf_bus.lock);
    *old = cpu_to_be32(*csr);
    if (swap && *old == request->data[0])
        *csr = be32_to_cpu(request->data[1]);
    return RCODE_COMPLETE;
}

static int read_rom(const struct request *request, __be32 *data) {
    size_t offset = request->offset - CSR_REGISTER_BASE - CSR_CONFIG_ROM;

    if (request->tcode != TCODE_READ_QUADLET_REQUEST && request->tcode != TCODE_READ_BLOCK_REQUEST)
        return RCODE_TYPE_ERROR;
    if (offset + request->length > sizeof(vf_bus.rom) || request->length > MOST_BYTES)
        return RCODE_ADDRESS_ERROR;
    guard(spinlock_irqsave)(&vf_bus.lock);
    memcpy(data, (u8 *)vf_bus.rom + offset, request->length);
    return RCODE_COMPLETE;
}

static void to_itself(struct fw_card *card, struct fw_packet *packet) {
    struct request request = parse(packet);
    u64 csr = request.offset - CSR_REGISTER_BASE;
    __be32 data[MOST_BYTES / 4];

    if (csr >= CSR_CONFIG_ROM && csr < CSR_CONFIG_ROM_END) {
        int rcode = read_rom(&request, data);

        respond(card, packet, rcode, data, request.length);
    } else if (csr >= CSR_BUS_MANAGER_ID && csr <= CSR_CHANNELS_AVAILABLE_LO) {
        int rcode = lock_csr(&request, data);

        respond(card, packet, rcode, data, 4);
    } else {
        finish(card, packet, ACK_PENDING);
        fw_core_handle_request(card, packet);
    }
}

static int ask_camera(struct vf_camera *camera, const struct request *request, __be32 *data) {
    if (request->length > MOST_BYTES || request->length & 3 || request->offset & 3)
        return RCODE_TYPE_ERROR;
    switch (request->tcode) {
    case TCODE_READ_QUADLET_REQUEST:
    case TCODE_READ_BLOCK_REQUEST: return vf_camera_read(camera, request->offset, data, request->length);
    case TCODE_WRITE_QUADLET_REQUEST:
    case TCODE_WRITE_BLOCK_REQUEST: return vf_camera_write(camera, request->offset, request->data, request->length);
    }
    return RCODE_TYPE_ERROR;
}

static void to_camera(struct fw_card *card, struct fw_packet *packet, struct vf_camera *camera) {
    struct request request = parse(packet);
    __be32 data[MOST_BYTES / 4];

    if (READ_ONCE(camera->silent)) {
        finish(card, packet, ACK_PENDING);
    } else {
        int rcode = ask_camera(camera, &request, data);

        respond(card, packet, rcode, data, request.length);
    }
}

static struct vf_camera *camera_of_node(int node, int generation, bool *stale) {
    guard(spinlock_irqsave)(&vf_bus.lock);
    *stale = generation != vf_bus.generation;
    return node >= 0 && node < (int)vf_bus.nodes ? vf_bus.node[node] : NULL;
}

void vf_send_request(struct fw_card *card, struct fw_packet *packet) {
    int destination = packet->header[0] >> 16;
    unsigned int tcode = packet->header[0] >> 4 & 0xf;
    bool stale;
    struct vf_camera *camera = camera_of_node(destination - LOCAL_BUS, packet->generation, &stale);

    packet->timestamp = vf_timestamp(vf_cycle());
    if (tcode == TCODE_LINK_INTERNAL || tcode == TCODE_STREAM_DATA || (destination & 0x3f) == 0x3f)
        finish(card, packet, ACK_COMPLETE);
    else if (stale)
        finish(card, packet, RCODE_GENERATION);
    else if (destination == card->node_id)
        to_itself(card, packet);
    else if (camera)
        to_camera(card, packet, camera);
    else
        finish(card, packet, RCODE_NO_ACK);
}

/* Cameras send no requests, so a response is always for the host itself. */
void vf_send_response(struct fw_card *card, struct fw_packet *packet) {
    packet->timestamp = vf_timestamp(vf_cycle());
    fw_core_handle_response(card, packet);
    finish(card, packet, ACK_COMPLETE);
}
