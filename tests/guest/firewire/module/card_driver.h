/* SPDX-License-Identifier: GPL-2.0 */
/*
 * The interface of a controller's driver and firewire-core: drivers/firewire/core.h of Linux 6.12, which is in no
 * package of kernel headers. Linux 6.13 and later may differ, so the build refuses them.
 */
#ifndef CARD_DRIVER_H
#define CARD_DRIVER_H

#include <linux/firewire-constants.h>
#include <linux/firewire.h>
#include <linux/version.h>

#if LINUX_VERSION_CODE < KERNEL_VERSION(6, 12, 0) || LINUX_VERSION_CODE >= KERNEL_VERSION(6, 13, 0)
#error "compare struct fw_card_driver with drivers/firewire/core.h of this kernel"
#endif

#define PHY_BUS_RESET 0x40       /* in register 1 */
#define PHY_BUS_SHORT_RESET 0x40 /* in register 5 */
#define CSR_STATE_BIT_CMSTR (1 << 8)
#define BANDWIDTH_AVAILABLE_INITIAL 4915
#define TCODE_LINK_INTERNAL 0xe
#define LOCAL_BUS 0xffc0

struct fw_card_driver {
    int (*enable)(struct fw_card *card, const __be32 *config_rom, size_t length);
    int (*read_phy_reg)(struct fw_card *card, int address);
    int (*update_phy_reg)(struct fw_card *card, int address, int clear_bits, int set_bits);
    int (*set_config_rom)(struct fw_card *card, const __be32 *config_rom, size_t length);
    void (*send_request)(struct fw_card *card, struct fw_packet *packet);
    void (*send_response)(struct fw_card *card, struct fw_packet *packet);
    int (*cancel_packet)(struct fw_card *card, struct fw_packet *packet);
    int (*enable_phys_dma)(struct fw_card *card, int node_id, int generation);
    u32 (*read_csr)(struct fw_card *card, int csr_offset);
    void (*write_csr)(struct fw_card *card, int csr_offset, u32 value);
    struct fw_iso_context *(*allocate_iso_context)(struct fw_card *card, int type, int channel, size_t header_size);
    void (*free_iso_context)(struct fw_iso_context *ctx);
    int (*start_iso)(struct fw_iso_context *ctx, s32 cycle, u32 sync, u32 tags);
    int (*set_iso_channels)(struct fw_iso_context *ctx, u64 *channels);
    int (*queue_iso)(struct fw_iso_context *ctx, struct fw_iso_packet *packet, struct fw_iso_buffer *buffer,
                     unsigned long payload);
    void (*flush_queue_iso)(struct fw_iso_context *ctx);
    int (*flush_iso_completions)(struct fw_iso_context *ctx);
    int (*stop_iso)(struct fw_iso_context *ctx);
};

void fw_card_initialize(struct fw_card *card, const struct fw_card_driver *driver, struct device *device);
int fw_card_add(struct fw_card *card, u32 max_receive, u32 link_speed, u64 guid, unsigned int supported_isoc_contexts);
void fw_core_remove_card(struct fw_card *card);
void fw_core_handle_bus_reset(struct fw_card *card, int node_id, int generation, int self_id_count, u32 *self_ids,
                              bool bm_abdicate);
void fw_core_handle_request(struct fw_card *card, struct fw_packet *request);
void fw_core_handle_response(struct fw_card *card, struct fw_packet *packet);
void fw_fill_response(struct fw_packet *response, u32 *request_header, int rcode, void *payload, size_t length);

#endif
