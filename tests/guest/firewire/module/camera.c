// SPDX-License-Identifier: GPL-2.0
/*
 * A camera's configuration ROM and registers by IIDC 1.30: format 0, modes of 8 and 16 bits; format 7, mode 0: a part
 * of 640x480 in MONO8.
 */
#include "vfirewire.h"

#define ROM (CSR_REGISTER_BASE + CSR_CONFIG_ROM)
#define COMMANDS (CSR_REGISTER_BASE + 0xf00000)
#define GUID_LOW 4
#define MODEL_NAME 24
#define POSITION (VF_FORMAT7 + 0x08)
#define SIZE (VF_FORMAT7 + 0x0c)
#define CODING (VF_FORMAT7 + 0x10)
#define PIXELS (VF_FORMAT7 + 0x34)
#define BYTES (VF_FORMAT7 + 0x3c)
#define GREATEST_PACKET 4096

static const u32 rom[] = {
    0x04040000, 0x31333934, 0x20008002, 0x00b09d01, 0x00abcde0, /* bus information */
    0x00030000, 0x0300b09d, 0x0c0083c0, 0xd1000001,             /* root directory */
    0x00030000, 0x1200a02d, 0x13000102, 0xd4000001,             /* unit: IIDC 1.30 */
    0x00030000, 0x403c0000, 0x81000002, 0x82000005,             /* command registers, vendor, model */
    0x00030000, 0,          0,          0x41434d45,             /* ACME */
    0x00030000, 0,          0,          0x43414d30,             /* CAM0 */
};

static const struct {
    u16 offset;
    u32 value;
} initial[] = {
    {0x100, 0x81000000}, /* formats 0 and 7 */
    {0x180, 0x5e000000}, /* its modes 1 (320x240 YUV422), 3 to 6 (640x480 YUV422, RGB8, MONO8, MONO16) */
    {0x204, 0x38000000},
    {0x20c, 0x38000000},
    {0x210, 0x38000000},
    {0x214, 0x38000000},
    {0x218, 0x38000000}, /* Hz */
    {0x19c, 0x80000000},
    {0x2e0, (0xf00000 + VF_FORMAT7) / 4}, /* mode 0 of format 7, and where it is */
    {VF_FORMAT7, 640 << 16 | 480},
    {VF_FORMAT7 + 0x04, 4 << 16 | 4},
    {SIZE, 640 << 16 | 480}, /* units of 4 pixels */
    {VF_FORMAT7 + 0x4c, 4 << 16 | 4},
    {VF_FORMAT7 + 0x14, 0x80000000}, /* codings: MONO8 */
    {VF_FORMAT7 + 0x40, 4 << 16 | GREATEST_PACKET},
    {VF_PACKET, GREATEST_PACKET << 16 | GREATEST_PACKET},
    {VF_FORMAT7 + 0x54, 8 << 24},
    {0x404, 0x80000000}, /* features: brightness */
    {0x500, 0x8b0000ff}, /* its range 0 to 255, readable, automatic, manual */
    {VF_FRAMERATE, 4u << 29},
    {VF_MODE, 5u << 29},
    {VF_ISO, 2u << 24},
    {0x800, 0x82000080},
};

/* Derived from size and packets; whole packets are sent. */
static void set_format7(u32 *registers) {
    u32 pixels = (registers[SIZE / 4] >> 16) * (registers[SIZE / 4] & 0xffff);
    u32 packet = registers[VF_PACKET / 4] >> 16 ?: GREATEST_PACKET;

    registers[PIXELS / 4] = pixels;
    registers[VF_PACKET / 4] = packet << 16 | GREATEST_PACKET;
    registers[VF_PACKETS / 4] = DIV_ROUND_UP(pixels, packet);
    registers[BYTES / 4] = registers[VF_PACKETS / 4] * packet;
}

void vf_camera_power_on(struct vf_camera *camera) {
    unsigned int i;

    guard(spinlock_irqsave)(&vf_bus.lock);
    memset(camera->registers, 0, sizeof(camera->registers));
    for (i = 0; i < ARRAY_SIZE(initial); i++)
        camera->registers[initial[i].offset / 4] = initial[i].value;
    set_format7(camera->registers);
    camera->silent = false;
    camera->session++;
    wake_up_all(&camera->wake);
}

static u32 rom_quadlet(const struct vf_camera *camera, unsigned int index) {
    return rom[index] + (index == GUID_LOW || index == MODEL_NAME ? camera->index : 0);
}

static int read_quadlet(const struct vf_camera *camera, u64 offset, u32 *value) {
    if (offset >= ROM && offset < ROM + sizeof(rom))
        *value = rom_quadlet(camera, (offset - ROM) / 4);
    else if (offset >= COMMANDS && offset < COMMANDS + sizeof(camera->registers))
        *value = camera->registers[(offset - COMMANDS) / 4];
    else
        return RCODE_ADDRESS_ERROR;
    return RCODE_COMPLETE;
}

static bool writable(u64 command) {
    return (command >= VF_FRAMERATE && command < 0x630) || (command >= 0x800 && command < 0x900) ||
           command == POSITION || command == SIZE || command == CODING || command == VF_PACKET;
}

static int write_quadlet(struct vf_camera *camera, u64 offset, u32 value) {
    u64 command = offset - COMMANDS;

    if (offset < COMMANDS || command >= sizeof(camera->registers))
        return RCODE_ADDRESS_ERROR;
    if (!writable(command))
        return RCODE_TYPE_ERROR;
    camera->registers[command / 4] = value;
    set_format7(camera->registers);
    if (command == VF_ISO_EN) {
        camera->session++;
        wake_up_all(&camera->wake);
    }
    return RCODE_COMPLETE;
}

int vf_camera_read(struct vf_camera *camera, u64 offset, __be32 *data, size_t length) {
    guard(spinlock_irqsave)(&vf_bus.lock);
    for (; length; length -= 4, offset += 4, data++) {
        u32 value;
        int rcode = read_quadlet(camera, offset, &value);

        if (rcode != RCODE_COMPLETE)
            return rcode;
        *data = cpu_to_be32(value);
    }
    return RCODE_COMPLETE;
}

int vf_camera_write(struct vf_camera *camera, u64 offset, const __be32 *data, size_t length) {
    guard(spinlock_irqsave)(&vf_bus.lock);
    for (; length; length -= 4, offset += 4, data++) {
        int rcode = write_quadlet(camera, offset, be32_to_cpu(*data));

        if (rcode != RCODE_COMPLETE)
            return rcode;
    }
    return RCODE_COMPLETE;
}
