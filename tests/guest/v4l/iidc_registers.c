/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "iidc_registers.h"

#include <string.h>

#include "v4l.h"

#define ROM UINT32_C(0xf0000400)
#define COMMANDS UINT32_C(0xf0f00000)
#define FORMAT7 UINT32_C(0xf0f01000)
#define PRESENT UINT32_C(0x80000000)
#define BRIGHTNESS 0
#define WHITE_BALANCE 3
#define UNIT 4 /* pixels, of size and position in FORMAT7 */
#define PACKET_UNIT 4
#define PACKET_GREATEST 4096

/* Bits of a pixel by coding number: MONO8, YUV 4:1:1, 4:2:2, 4:4:4, RGB8, MONO16, RGB16, two signed ones (not
 * supported), RAW8, RAW16. */
static const unsigned coding_bits[IIDC_CODINGS] = {8, 12, 16, 24, 24, 16, 48, 0, 0, 8, 16};

/* FORMAT0, by mode number. */
static const struct {
    unsigned width, height, coding;
} modes[] = {{160, 120, 3}, {320, 240, 2}, {640, 480, 1}, {640, 480, 2}, {640, 480, 4}, {640, 480, 0}, {640, 480, 5}};
#define MODES (sizeof(modes) / sizeof(*modes))

void iidc_reset(struct iidc_registers *registers, uint64_t guid, unsigned width, unsigned height) {
    *registers = (struct iidc_registers){.guid = guid, .width = width, .height = height, .depth = 16};
    registers->mode = UINT32_C(5) << 29; /* 640x480 MONO8 */
    registers->rate = UINT32_C(3) << 29; /* 15 a second */
    registers->size = width << 16 | height;
    registers->packet = PACKET_GREATEST;
    registers->feature[BRIGHTNESS] = PRESENT | 0x02000000 | 100;
    registers->feature[WHITE_BALANCE] = PRESENT | 0x03000000 | 40 << 12 | 60;
}

void iidc_option(struct iidc_registers *registers, const char *word) {
    if (!strcmp(word, "counter"))
        registers->counter = true;
    else if (!strcmp(word, "bayer"))
        registers->bayer = true;
    else if (!strcmp(word, "depth12"))
        registers->depth = 12;
    else
        fail("option %s", word);
}

/* Bus info block, root directory, unit directory, unit dependent directory, two names. */
static bool read_rom(const struct iidc_registers *registers, unsigned quad, uint32_t *value) {
    const uint32_t rom[] = {
        0x04040000,
        0x31333934,
        0,
        (uint32_t)(registers->guid >> 32),
        (uint32_t)registers->guid, /* 0 */
        0x00030000,
        0x0300b09d,
        0x0c0083c0,
        0xd1000001, /* 5 */
        0x00030000,
        0x1200a02d,
        0x13000102,
        0xd4000001, /* 9 */
        0x00040000,
        0x403c0000,
        0x81000003,
        0x82000006,
        0x38000010, /* 13 */
        0x00030000,
        0,
        0,
        0x54657374, /* 18: "Test" */
        0x00030000,
        0,
        0,
        0x43616d00, /* 22: "Cam" */
    };
    if (quad >= sizeof(rom) / sizeof(*rom))
        return false;
    *value = rom[quad];
    return true;
}

struct iidc_picture iidc_picture(const struct iidc_registers *registers) {
    unsigned mode = registers->mode >> 29;
    struct iidc_picture picture = {.sensor_width = registers->width, .sensor_height = registers->height};
    if (registers->format >> 29 == 7) {
        picture.left = registers->position >> 16;
        picture.top = registers->position & 0xffff;
        picture.width = registers->size >> 16;
        picture.height = registers->size & 0xffff;
        picture.coding = registers->coding >> 24 < IIDC_CODINGS ? registers->coding >> 24 : 0;
    } else {
        mode = mode < MODES ? mode : 0;
        picture.sensor_width = picture.width = modes[mode].width;
        picture.sensor_height = picture.height = modes[mode].height;
        picture.coding = modes[mode].coding;
    }
    picture.bits = coding_bits[picture.coding];
    return picture;
}

static uint32_t bytes_of(const struct iidc_registers *registers) {
    struct iidc_picture picture = iidc_picture(registers);
    return picture.width * picture.height * picture.bits / 8;
}

static uint32_t read_format7(const struct iidc_registers *registers, unsigned offset) {
    uint32_t codings = 0, packets = (bytes_of(registers) + registers->packet - 1) / registers->packet;
    for (unsigned i = 0; i < IIDC_CODINGS; i++)
        codings |= coding_bits[i] ? PRESENT >> i : 0;
    switch (offset) {
    case 0x00: return registers->width << 16 | registers->height;
    case 0x04:
    case 0x4c: return UNIT << 16 | UNIT;
    case 0x08: return registers->position;
    case 0x0c: return registers->size;
    case 0x10: return registers->coding;
    case 0x14: return codings;
    case 0x34: return (registers->size >> 16) * (registers->size & 0xffff);
    case 0x3c: return packets * registers->packet;
    case 0x40: return PACKET_UNIT << 16 | PACKET_GREATEST;
    case 0x44: return registers->packet << 16 | PACKET_GREATEST;
    case 0x48: return packets;
    case 0x54: return registers->depth << 24;
    case 0x58: return registers->bayer ? 2 << 24 : UINT32_C(0xff000000); /* GRBG */
    default: return 0;
    }
}

static uint32_t read_command(const struct iidc_registers *registers, unsigned offset) {
    if (offset >= 0x200 && offset < 0x200 + 4 * MODES)
        return 0x38000000; /* 7.5, 15 and 30 frames a second */
    switch (offset) {
    case 0x100: return PRESENT | 0x01000000; /* FORMAT0 and FORMAT7 */
    case 0x180: return ~(UINT32_MAX >> MODES);
    case 0x19c: return PRESENT;
    case 0x2e0: return (FORMAT7 - UINT32_C(0xf0000000)) / 4;
    case 0x400: return PRESENT;
    case 0x404: return PRESENT | 0x10000000;                  /* brightness, white balance */
    case 0x500: return PRESENT | 0x1f000000 | 16 << 12 | 235; /* one push, on and off, automatic, manual */
    case 0x50c: return PRESENT | 0x0b000000 | 0 << 12 | 255;
    case 0x600: return registers->rate;
    case 0x604: return registers->mode;
    case 0x608: return registers->format;
    case 0x60c: return registers->iso;
    case 0x614: return registers->sending ? PRESENT : 0;
    case 0x630: return registers->depth << 24;
    case 0x800: return registers->feature[BRIGHTNESS];
    case 0x80c: return registers->feature[WHITE_BALANCE];
    case 0x1040: return registers->bayer ? 0x47524247 : 0x59595959; /* "GRBG", "YYYY" */
    case 0x12f8: return registers->counter ? PRESENT | (registers->counter_on ? 0x40 : 0) : 0;
    default: return 0;
    }
}

bool iidc_read(const struct iidc_registers *registers, uint32_t address, uint32_t *value) {
    if (address >= ROM && address < ROM + 0x400)
        return read_rom(registers, (address - ROM) / 4, value);
    if (address >= FORMAT7 && address < FORMAT7 + 0x100)
        *value = read_format7(registers, address - FORMAT7);
    else
        *value = read_command(registers, address - COMMANDS);
    return true;
}

static void write_format7(struct iidc_registers *registers, unsigned offset, uint32_t value) {
    switch (offset) {
    case 0x08: registers->position = value; break;
    case 0x0c: registers->size = value; break;
    case 0x10: registers->coding = value; break;
    case 0x44: registers->packet = value >> 16 ? value >> 16 : PACKET_GREATEST; break;
    default: break;
    }
}

void iidc_write(struct iidc_registers *registers, uint32_t address, uint32_t value) {
    if (address >= FORMAT7 && address < FORMAT7 + 0x100) {
        write_format7(registers, address - FORMAT7, value);
        return;
    }
    switch (address - COMMANDS) {
    case 0x600: registers->rate = value; break;
    case 0x604: registers->mode = value; break;
    case 0x608: registers->format = value; break;
    case 0x60c: registers->iso = value; break;
    case 0x614: registers->sending = value & PRESENT; break;
    case 0x800: registers->feature[BRIGHTNESS] = value & ~UINT32_C(0x04000000); break; /* one push is done at once */
    case 0x80c: registers->feature[WHITE_BALANCE] = value & ~UINT32_C(0x04000000); break;
    case 0x12f8: registers->counter_on = registers->counter && value & 0x40; break;
    default: break;
    }
}
