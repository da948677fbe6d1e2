/* SPDX-License-Identifier: GPL-2.0-or-later */
/* v4l uvc YUYV|MJPG WIDTH HEIGHT MS FILE
 *
 * A USB camera (vhci_hcd) that shows a file in a loop, a frame each MS milliseconds while the host requests them:
 * YUYV: a 4:2:0 clip, MJPG: concatenated JPEG pictures. One control: brightness, 0 to 200 in steps of 2.
 * USR1: sends the next frame as damaged, then prints "damaged" and their count; a further signal before that may
 * merge with it. On TERM it prints the number of frames sent, and of damaged ones. */
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "usb.h"
#include "v4l.h"

#define PAYLOAD 16384
#define IDLE_MS 1000
#define LE16(x) (x) & 0xff, ((x) >> 8) & 0xff
#define LE32(x) LE16(x), ((x) >> 16) & 0xff, ((x) >> 24) & 0xff
#define VIDEO 0x0e
#define INTERFACE(number, endpoints, subclass) 9, 4, number, 0, endpoints, VIDEO, subclass, 0, 0

enum { SET_CUR = 0x01, GET_CUR = 0x81, GET_MIN, GET_MAX, GET_RES, GET_LEN, GET_INFO, GET_DEF };

static struct source {
    bool jpeg;
    unsigned width, height, interval; /* of 100 ns */
    size_t largest;
} source;
static uint8_t probe[26];
static int brightness = 100;
static volatile sig_atomic_t damage, stop;

static void on_signal(int number) {
    if (number == SIGUSR1)
        damage++;
    else
        stop = 1;
}

/* ---- Descriptors ---- */

static int device_descriptor(uint8_t *to) {
    const uint8_t bytes[] = {18, 1, LE16(0x200), 0xef, 2, 1, 64, LE16(0x1d6b), LE16(0x0102), LE16(1), 0, 2, 0, 1};
    memcpy(to, bytes, sizeof(bytes));
    return sizeof(bytes);
}

static int config_descriptor(uint8_t *to) {
    const unsigned size = (unsigned)source.largest;
    const uint8_t head[] = {9,
                            2,
                            LE16(0),
                            2,
                            1,
                            0,
                            0x80,
                            50, /* its length follows below */
                            8,
                            11,
                            0,
                            2,
                            VIDEO,
                            3,
                            0,
                            0,                  /* the two interfaces belong together */
                            INTERFACE(0, 0, 1), /* control */
                            13,
                            0x24,
                            1,
                            LE16(0x100),
                            LE16(51),
                            LE32(48000000),
                            1,
                            1, /* header */
                            18,
                            0x24,
                            2,
                            1,
                            LE16(0x201),
                            0,
                            0,
                            LE16(0),
                            LE16(0),
                            LE16(0),
                            3,
                            0,
                            0,
                            0, /* camera */
                            11,
                            0x24,
                            5,
                            2,
                            1,
                            LE16(0),
                            2,
                            LE16(1),
                            0, /* brightness */
                            9,
                            0x24,
                            3,
                            3,
                            LE16(0x101),
                            0,
                            2,
                            0,                   /* output */
                            INTERFACE(1, 1, 2)}; /* stream */
    const uint8_t yuyv[] = {27, 0x24, 4,    1, 1,    'Y',  'U',  'Y', '2', 0, 0, 0x10, 0, 0x80,
                            0,  0,    0xaa, 0, 0x38, 0x9b, 0x71, 16,  1,   0, 0, 0,    0};
    const uint8_t jpeg[] = {11, 0x24, 6, 1, 1, 1, 1, 0, 0, 0, 0};
    const uint8_t frame[] = {30,
                             0x24,
                             source.jpeg ? 7 : 5,
                             1,
                             0,
                             LE16(source.width),
                             LE16(source.height),
                             LE32(size),
                             LE32(size),
                             LE32(size),
                             LE32(source.interval),
                             1,
                             LE32(source.interval)};
    const uint8_t endpoint[] = {7, 5, 0x81, 2, LE16(512), 0};
    const uint8_t *format = source.jpeg ? jpeg : yuyv;
    size_t format_size = source.jpeg ? sizeof(jpeg) : sizeof(yuyv), at = sizeof(head);
    unsigned stream = 14 + (unsigned)format_size + sizeof(frame);
    const uint8_t header[] = {14, 0x24, 1, 1, LE16(stream), 0x81, 0, 3, 0, 0, 0, 1, 0};
    memcpy(to, head, at);
    memcpy(to + at, header, sizeof(header));
    at += sizeof(header);
    memcpy(to + at, format, format_size);
    at += format_size;
    memcpy(to + at, frame, sizeof(frame));
    at += sizeof(frame);
    memcpy(to + at, endpoint, sizeof(endpoint));
    at += sizeof(endpoint);
    to[2] = (uint8_t)at;
    to[3] = (uint8_t)(at >> 8);
    return (int)at;
}

static int string_descriptor(unsigned number, uint8_t *to) {
    static const char name[] = "numbered frames";
    if (!number) {
        memcpy(to, (const uint8_t[]){4, 3, LE16(0x409)}, 4);
        return 4;
    }
    to[0] = 2 * sizeof(name);
    to[1] = 3;
    for (unsigned i = 0; i < sizeof(name) - 1; i++)
        to[2 + 2 * i] = (uint8_t)name[i];
    return 2 * sizeof(name);
}

/* ---- Requests ---- */

static void fill_probe(void) {
    const uint8_t bytes[26] = {LE16(1), 1,       1,       LE32(source.interval),          LE16(0),      LE16(0),
                               LE16(0), LE16(0), LE16(0), LE32((unsigned)source.largest), LE32(PAYLOAD)};
    memcpy(probe, bytes, sizeof(probe));
}

static int stream_request(const struct usb_request *request, uint8_t *data) {
    switch (request->request) {
    case SET_CUR: return 0; /* there is only one format */
    case GET_LEN: data[0] = sizeof(probe); return 2;
    case GET_INFO: data[0] = 3; return 1;
    default: memcpy(data, probe, sizeof(probe)); return sizeof(probe);
    }
}

static int brightness_request(const struct usb_request *request, uint8_t *data) {
    int value = 0;
    switch (request->request) {
    case SET_CUR: brightness = (int16_t)(data[0] | data[1] << 8); return 0;
    case GET_CUR: value = brightness; break;
    case GET_MIN: value = 0; break;
    case GET_MAX: value = 200; break;
    case GET_RES: value = 2; break;
    case GET_DEF: value = 100; break;
    case GET_LEN: value = 2; break;
    case GET_INFO: data[0] = 3; return 1;
    default: return -1;
    }
    data[0] = (uint8_t)value;
    data[1] = (uint8_t)(value >> 8);
    return 2;
}

static int answer(const struct usb_request *request, uint8_t *data) {
    if ((request->type & 0x60) == 0x20) { /* of the video class */
        if ((request->index & 0xff) == 1)
            return stream_request(request, data);
        return request->index >> 8 == 2 && request->value >> 8 == 2 ? brightness_request(request, data) : -1;
    }
    switch (request->request) {
    case 0: return 2; /* GET_STATUS */
    case 1:
    case 3: return 0; /* CLEAR_FEATURE, SET_FEATURE */
    case 9:
    case 11: return 0; /* SET_CONFIGURATION, SET_INTERFACE */
    case 6: break;     /* GET_DESCRIPTOR */
    default: return -1;
    }
    switch (request->value >> 8) {
    case 1: return device_descriptor(data);
    case 2: return config_descriptor(data);
    case 3: return string_descriptor(request->value & 0xff, data);
    default: return -1;
    }
}

/* ---- Pictures ---- */

static void to_yuyv(const struct clip *clip, unsigned number, uint8_t *to) {
    const uint8_t *y = clip_frame(clip, number), *u = y + clip->width * clip->height;
    const uint8_t *v = u + clip->width * clip->height / 4;
    for (unsigned row = 0; row < clip->height; row++)
        for (unsigned x = 0; x < clip->width; x += 2) {
            unsigned chroma = row / 2 * (clip->width / 2) + x / 2;
            *to++ = y[row * clip->width + x];
            *to++ = u[chroma];
            *to++ = y[row * clip->width + x + 1];
            *to++ = v[chroma];
        }
}

/* The next JPEG picture at *at; after the last one, the first. */
static size_t next_jpeg(const struct clip *file, size_t *at, const uint8_t **picture) {
    if (*at + 4 > file->size)
        *at = 0;
    *picture = file->data + *at;
    for (size_t end = *at + 2; end + 1 < file->size; end++)
        if (file->data[end] == 0xff && file->data[end + 1] == 0xd9) {
            size_t size = end + 2 - *at;
            *at = end + 2;
            return size;
        }
    fail("no end of a picture");
}

static void send_frame(struct usb_device *device, const uint8_t *picture, size_t size, unsigned number, bool damaged) {
    static uint8_t payload[PAYLOAD];
    for (size_t at = 0; at < size;) {
        size_t part = size - at < PAYLOAD - 2 ? size - at : PAYLOAD - 2;
        bool last = at + part == size;
        payload[0] = 2;
        payload[1] = (uint8_t)(0x80 | (number & 1) | (last ? 2 : 0) | (damaged ? 0x40 : 0));
        memcpy(payload + 2, picture + at, part);
        while (!device->pending_count && !stop)
            usb_serve(device, 100, true);
        if (stop || !usb_send(device, payload, part + 2))
            return;
        at += part;
    }
}

int uvc(int argc, char **argv) {
    struct usb_device device = {.control = answer};
    struct clip clip = {0};
    size_t at = 0;
    unsigned sent = 0, damaged = 0;
    if (argc != 6)
        fail("usage");
    source = (struct source){.jpeg = !strcmp(argv[1], "MJPG"),
                             .width = (unsigned)atoi(argv[2]),
                             .height = (unsigned)atoi(argv[3]),
                             .interval = (unsigned)atoi(argv[4]) * 10000};
    source.largest = (size_t)source.width * source.height * 2;
    uint8_t *yuyv = malloc(source.largest);
    if (source.jpeg)
        file_read(&clip, argv[5]);
    else
        clip_read(&clip, argv[5]);
    fill_probe();
    signal(SIGUSR1, on_signal);
    signal(SIGTERM, on_signal);
    usb_plug(&device, 0);
    int64_t due = now_ms();
    for (unsigned number = 0; !stop; number++) {
        while (!device.pending_count && !stop)
            usb_serve(&device, 100, true);
        if (due < now_ms() - IDLE_MS) /* the host requested none */
            due = now_ms();
        usb_serve(&device, due > now_ms() ? due - now_ms() : 0, false);
        due += atol(argv[4]);
        const uint8_t *picture = yuyv;
        size_t size = source.jpeg ? next_jpeg(&clip, &at, &picture) : source.largest;
        if (!source.jpeg)
            to_yuyv(&clip, number % clip.frames, yuyv);
        bool hurt = damage != 0;
        send_frame(&device, picture, size, number, hurt);
        sent++;
        if (hurt) {
            damage = 0;
            printf("damaged %u\n", ++damaged);
            fflush(stdout);
        }
    }
    printf("sent %u damaged %u brightness %d\n", sent, damaged, brightness);
    return 0;
}
