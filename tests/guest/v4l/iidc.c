/* SPDX-License-Identifier: GPL-2.0-or-later */
/* v4l iidc PORT GUID WIDTH HEIGHT MS FILE [OPTION...]
 *
   * A USB camera of the IIDC standard (vhci_hcd): registers by control requests, frames by one bulk transfer each. It
   * has FORMAT7_0 of this size, in all codings, and the modes of FORMAT0. It shows the frames of FILE.CODING in a loop
   * (CODING: number of the coding that the host chose), each of the whole sensor. Options: `counter`, it can write a
   * frame's number into the first pixels; `bayer`, it reports its pattern; `depth12`, samples of 16 bits use 12.
 *
   * Commands on standard input, one per line, each confirmed by `done WORD`: `short`, send half a frame; `stall`, stall
   * the endpoint once; `skip`, three frames are never sent; `silent`, stop answering requests; `answer`, answer again.
   * On TERM it prints the number of frames sent, and its brightness. */
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "iidc_registers.h"
#include "usb.h"
#include "v4l.h"

#define IDLE_MS 1000
#define SKIPPED 3
#define LE16(x) (x) & 0xff, ((x) >> 8) & 0xff

static struct iidc_registers registers;
static volatile sig_atomic_t stop;
static bool silent;

static void on_signal(int number) {
    (void)number;
    stop = 1;
}

static int descriptor(unsigned kind, uint8_t *to) {
    const uint8_t device[] = {18, 1, LE16(0x200), 0, 0, 0, 64, LE16(0x1e10), LE16(0x2004), LE16(1), 0, 0, 0, 1};
    const uint8_t config[] = {9, 2,    LE16(25), 1, 1, 0, 0x80, 50,   9, 4,         0, 0,
                              1, 0xff, 0,        0, 0, 7, 5,    0x81, 2, LE16(512), 0};
    if (kind == 1)
        memcpy(to, device, sizeof(device));
    else if (kind == 2)
        memcpy(to, config, sizeof(config));
    return kind == 1 ? (int)sizeof(device) : kind == 2 ? (int)sizeof(config) : -1;
}

static uint32_t get_quad(const uint8_t *from) {
    return (uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
}

/* Registers: whole quadlets, least significant byte first. */
static int registers_request(const struct usb_request *request, uint8_t *data) {
    uint32_t address = (uint32_t)request->index << 16 | request->value;
    if (silent)
        return USB_NO_ANSWER;
    for (unsigned at = 0; at + 4 <= request->length; at += 4) {
        uint32_t value;
        if (!(request->type & 0x80)) {
            iidc_write(&registers, address + at, get_quad(data + at));
        } else if (iidc_read(&registers, address + at, &value)) {
            for (int i = 0; i < 4; i++)
                data[at + (unsigned)i] = (uint8_t)(value >> 8 * i);
        } else {
            return -1;
        }
    }
    return request->length;
}

static int answer(const struct usb_request *request, uint8_t *data) {
    if ((request->type & 0x60) == 0x40)
        return request->request == 0x7f ? registers_request(request, data) : -1;
    switch (request->request) {
    case 0: return 2;  /* GET_STATUS */
    case 1:            /* CLEAR_FEATURE */
    case 3:            /* SET_FEATURE */
    case 9:            /* SET_CONFIGURATION */
    case 11: return 0; /* SET_INTERFACE */
    case 6: return descriptor(request->value >> 8, data);
    default: return -1;
    }
}

/* ---- Frames ---- */

/* The part of the sensor that the host wants, in the number of bytes that it expects. */
static void draw(const struct clip *files, unsigned number, uint8_t *to, size_t size) {
    struct iidc_picture picture = iidc_picture(&registers);
    const struct clip *file = &files[picture.coding];
    size_t row = (size_t)picture.sensor_width * picture.bits / 8, sensor = row * picture.sensor_height;
    size_t wanted = (size_t)picture.width * picture.bits / 8, left = (size_t)picture.left * picture.bits / 8;
    size_t frames = file->size / sensor ? file->size / sensor : 1;
    const uint8_t *from = file->data + number % frames * sensor;
    memset(to, 0, size);
    for (unsigned y = 0; y < picture.height && (y + 1) * wanted <= size; y++) {
        size_t at = (picture.top + y) * row + left;
        if ((size_t)(from - file->data) + at + wanted <= file->size)
            memcpy(to + y * wanted, from + at, wanted);
    }
    for (int i = 0; i < 4 && registers.counter_on; i++)
        to[i] = (uint8_t)(number >> (24 - 8 * i));
}

static void did(const char *word) {
    printf("done %s\n", word);
    fflush(stdout);
}

/* The test's next command; the FIFO may be without a writer. */
static const char *next_word(void) {
    static char word[16];
    static unsigned length;
    char byte;
    while (read(0, &byte, 1) == 1) {
        if (byte == '\n') {
            word[length] = 0;
            length = 0;
            return word;
        }
        if (length < sizeof(word) - 1)
            word[length++] = byte;
    }
    return NULL;
}

/* The command for the next frame, or NULL. Commands that concern no frame are carried out at once. */
static const char *word_for_frame(void) {
    const char *word = next_word();
    if (word && (!strcmp(word, "silent") || !strcmp(word, "answer"))) {
        silent = !strcmp(word, "silent");
        did(word);
        return NULL;
    }
    return word;
}

/* False if this frame is not sent. */
static bool spoil(struct usb_device *device, const char *word, unsigned *number, size_t *size) {
    if (!strcmp(word, "short"))
        *size /= 2;
    else if (!strcmp(word, "skip"))
        *number += SKIPPED - 1;
    else if (!strcmp(word, "stall"))
        usb_stall(device);
    else
        fail("word %s", word);
    return !strcmp(word, "short");
}

/* The host must be waiting for it. */
static void send_frame(struct usb_device *device, const struct clip *files, const char *word, unsigned *number,
                       unsigned *sent) {
    static uint8_t memory[IIDC_LARGEST];
    size_t size = device->pending[0].length;
    draw(files, *number, memory, size);
    if (!word || spoil(device, word, number, &size))
        *sent += usb_send(device, memory, size);
    if (word)
        did(word);
}

static void read_files(struct clip files[IIDC_CODINGS], const char *path) {
    char name[256];
    for (unsigned i = 0; i < IIDC_CODINGS; i++) {
        snprintf(name, sizeof(name), "%s.%u", path, i);
        if (!access(name, R_OK))
            file_read(&files[i], name);
    }
}

int iidc(int argc, char **argv) {
    struct usb_device device = {.control = answer};
    static struct clip files[IIDC_CODINGS];
    if (argc < 7)
        fail("usage");
    iidc_reset(&registers, strtoull(argv[2], NULL, 16), (unsigned)atoi(argv[3]), (unsigned)atoi(argv[4]));
    for (int i = 7; i < argc; i++)
        iidc_option(&registers, argv[i]);
    read_files(files, argv[6]);
    fcntl(0, F_SETFL, O_NONBLOCK);
    signal(SIGTERM, on_signal);
    usb_plug(&device, (unsigned)atoi(argv[1]));
    unsigned number = 0, sent = 0;
    const char *word = NULL;
    for (int64_t due = now_ms(); !stop; due += atol(argv[5])) {
        if (due < now_ms() - IDLE_MS)
            due = now_ms();
        usb_serve(&device, due > now_ms() ? due - now_ms() : 0, false);
        if (!word)
            word = word_for_frame();
        if (!registers.sending)
            continue;
        if (device.pending_count && device.pending[0].length <= IIDC_LARGEST) {
            send_frame(&device, files, word, &number, &sent);
            word = NULL;
        }
        number++; /* without a waiting host the frame is lost inside the camera */
    }
    printf("sent %u brightness %u\n", sent, registers.feature[0] & 0xfff);
    return 0;
}
