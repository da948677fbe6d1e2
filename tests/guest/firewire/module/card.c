// SPDX-License-Identifier: GPL-2.0
/* The card: its cycle timer, bus resets, loading and unloading of the module. */
#include <linux/dma-mapping.h>
#include <linux/ktime.h>
#include <linux/math64.h>
#include <linux/module.h>
#include <linux/platform_device.h>

#include "vfirewire.h"

#define GUID 0x00b09d0100fffff0ULL
#define MAX_RECEIVE 10 /* 2048 bytes */

static unsigned int cameras = 1;
module_param(cameras, uint, 0444);
MODULE_PARM_DESC(cameras, "how many, 1 to 5");

struct vf_bus vf_bus;
static struct platform_device *device;

u64 vf_cycle(void) {
    return div_u64(ktime_get_ns(), 125000);
}

u32 vf_timestamp(u64 cycle) {
    u32 rest;
    u64 seconds = div_u64_rem(cycle, 8000, &rest);

    return (seconds & 7) << 13 | rest;
}

static u32 cycle_timer(void) {
    u32 ns, cycle;
    u64 seconds = div_u64_rem(ktime_get_ns(), NSEC_PER_SEC, &ns);

    cycle = ns / 125000;
    return (seconds & 127) << 25 | cycle << 12 | ns % 125000 * 3072 / 125000;
}

void vf_schedule_reset(void) {
    scoped_guard(spinlock_irqsave, &vf_bus.lock) if (!vf_bus.closing) schedule_work(&vf_bus.reset);
}

/* Self-IDs of a star: 400 Mbit/s, link on, the gap count that the bus manager would choose. */
static u32 self_id(unsigned int node, unsigned int gap) {
    return 2u << 30 | node << 24 | 1 << 22 | gap << 16 | SCODE_400 << 14;
}

/* The card has five ports, which takes two quadlets; it is the root and the only possible bus manager. */
static unsigned int fill_self_ids(u32 *ids) {
    static const u8 gap_counts[] = {63, 5, 7};
    unsigned int gap, port, node = 0, status[VF_CAMERAS];

    for (port = 0; port < VF_CAMERAS; port++) {
        struct vf_camera *camera = &vf_bus.camera[port];

        status[port] = camera->plugged ? 3 : 1;
        if (camera->plugged)
            vf_bus.node[node++] = camera;
    }
    vf_bus.nodes = node;
    gap = gap_counts[min(node, 2u)];
    for (port = 0; port < node; port++)
        ids[port] = self_id(port, gap) | 2 << 6;
    ids[node] = self_id(node, gap) | 1 << 11 | status[0] << 6 | status[1] << 4 | status[2] << 2 | 1;
    ids[node + 1] = 2u << 30 | node << 24 | 1 << 23 | status[3] << 16 | status[4] << 14;
    return node + 2;
}

static void reset(struct work_struct *work) {
    u32 ids[VF_CAMERAS + 2];
    unsigned int count;
    int generation, node;

    scoped_guard(spinlock_irqsave, &vf_bus.lock) {
        count = fill_self_ids(ids);
        generation = vf_bus.generation = (vf_bus.generation + 1) & 0xff;
        node = LOCAL_BUS | vf_bus.nodes;
        vf_bus.csr[0] = 0x3f;
        vf_bus.csr[1] = BANDWIDTH_AVAILABLE_INITIAL;
        vf_bus.csr[2] = vf_bus.csr[3] = ~0;
    }
    fw_core_handle_bus_reset(&vf_bus.card, node, generation, count, ids, false);
}

static int set_config_rom(struct fw_card *card, const __be32 *rom, size_t length) {
    scoped_guard(spinlock_irqsave, &vf_bus.lock) {
        memset(vf_bus.rom, 0, sizeof(vf_bus.rom));
        memcpy(vf_bus.rom, rom, length * 4);
    }
    fw_schedule_bus_reset(card, true, true);
    return 0;
}

static int enable(struct fw_card *card, const __be32 *rom, size_t length) {
    memcpy(vf_bus.rom, rom, length * 4);
    vf_schedule_reset();
    return 0;
}

static int read_phy_reg(struct fw_card *card, int address) {
    return address == 1 ? 63 : 0; /* a gap count of 63: firewire-core leaves it as it is */
}

static int update_phy_reg(struct fw_card *card, int address, int clear_bits, int set_bits) {
    if ((address == 1 && set_bits & PHY_BUS_RESET) || (address == 5 && set_bits & PHY_BUS_SHORT_RESET))
        vf_schedule_reset();
    return 0;
}

/* No packet is left to cancel: each was sent when send_request() returned. */
static int cancel_packet(struct fw_card *card, struct fw_packet *packet) {
    return -ENOENT;
}

static int enable_phys_dma(struct fw_card *card, int node_id, int generation) {
    return -ENODEV;
}

static u32 read_csr(struct fw_card *card, int offset) {
    switch (offset) {
    case CSR_CYCLE_TIME: return cycle_timer();
    case CSR_NODE_IDS: return (u32)card->node_id << 16;
    case CSR_STATE_CLEAR:
    case CSR_STATE_SET: return CSR_STATE_BIT_CMSTR;
    }
    return 0;
}

static void write_csr(struct fw_card *card, int offset, u32 value) {}

const struct fw_card_driver vf_driver = {
    .enable = enable,
    .read_phy_reg = read_phy_reg,
    .update_phy_reg = update_phy_reg,
    .set_config_rom = set_config_rom,
    .send_request = vf_send_request,
    .send_response = vf_send_response,
    .cancel_packet = cancel_packet,
    .enable_phys_dma = enable_phys_dma,
    .read_csr = read_csr,
    .write_csr = write_csr,
    .allocate_iso_context = vf_iso_allocate,
    .free_iso_context = vf_iso_free,
    .start_iso = vf_iso_start,
    .set_iso_channels = vf_iso_set_channels,
    .queue_iso = vf_iso_queue,
    .flush_queue_iso = vf_iso_flush_queue,
    .flush_iso_completions = vf_iso_flush_completions,
    .stop_iso = vf_iso_stop,
};

static void stop_streams(void) {
    unsigned int i;

    for (i = 0; i < vf_bus.cameras; i++)
        vf_stream_stop(&vf_bus.camera[i]);
}

static int start_streams(void) {
    unsigned int i;

    for (i = 0; i < vf_bus.cameras; i++) {
        struct vf_camera *camera = &vf_bus.camera[i];
        int error;

        camera->index = i;
        camera->plugged = true;
        init_waitqueue_head(&camera->wake);
        vf_camera_power_on(camera);
        error = vf_stream_start(camera);
        if (error)
            return error;
    }
    return 0;
}

static int add_card(void) {
    int error = dma_coerce_mask_and_coherent(&device->dev, DMA_BIT_MASK(32));

    if (error)
        return error;
    fw_card_initialize(&vf_bus.card, &vf_driver, &device->dev);
    error = start_streams();
    if (!error)
        error = fw_card_add(&vf_bus.card, MAX_RECEIVE, SCODE_400, GUID, VF_CAMERAS);
    if (error)
        stop_streams();
    return error;
}

static int __init vf_init(void) {
    int error;

    if (cameras < 1 || cameras > VF_CAMERAS)
        return -EINVAL;
    spin_lock_init(&vf_bus.lock);
    INIT_LIST_HEAD(&vf_bus.contexts);
    INIT_WORK(&vf_bus.reset, reset);
    vf_bus.cameras = cameras;
    device = platform_device_register_simple(KBUILD_MODNAME, PLATFORM_DEVID_NONE, NULL, 0);
    if (IS_ERR(device))
        return PTR_ERR(device);
    error = add_card();
    if (error)
        platform_device_unregister(device);
    return error;
}

static void __exit vf_exit(void) {
    scoped_guard(spinlock_irqsave, &vf_bus.lock) vf_bus.closing = true;
    cancel_work_sync(&vf_bus.reset);
    stop_streams();
    fw_core_remove_card(&vf_bus.card);
    platform_device_unregister(device);
}

module_init(vf_init);
module_exit(vf_exit);
MODULE_DESCRIPTION("FireWire bus with IIDC cameras, for tests");
MODULE_LICENSE("GPL");
