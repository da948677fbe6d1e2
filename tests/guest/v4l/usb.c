/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "usb.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "v4l.h"

#define ATTACH "/sys/devices/platform/vhci_hcd.0/attach"
#define HIGH_SPEED 3
#define DEVICE_ID 0x10002

enum { CMD_SUBMIT = 1, CMD_UNLINK, RET_SUBMIT, RET_UNLINK };

/* The header of every message, in network order. */
struct message {
    uint32_t command, number, device, direction, endpoint;
    union {
        struct {
            uint32_t flags, length, start, packets, interval;
            uint8_t setup[8];
        } submit;
        struct {
            uint32_t status, length, start, packets, errors, padding[2];
        } done;
        uint32_t unlink; /* number of the transfer to cancel; in the answer: status */
    };
};
_Static_assert(sizeof(struct message) == 48, "the protocol");

static void put(int fd, const void *data, size_t size) {
    for (size_t at = 0; at < size;) {
        ssize_t sent = write(fd, (const char *)data + at, size - at);
        if (sent <= 0)
            fail("host");
        at += (size_t)sent;
    }
}

static void get(int fd, void *data, size_t size) {
    for (size_t at = 0; at < size;) {
        ssize_t got = read(fd, (char *)data + at, size - at);
        if (got <= 0)
            fail("host");
        at += (size_t)got;
    }
}

void usb_plug(struct usb_device *device, unsigned port) {
    int ends[2];
    FILE *file = fopen(ATTACH, "w");
    if (!file || socketpair(AF_UNIX, SOCK_STREAM, 0, ends))
        fail(ATTACH);
    fprintf(file, "%u %d %u %u", port, ends[1], DEVICE_ID, HIGH_SPEED);
    if (fclose(file))
        fail("plug in");
    close(ends[1]);
    device->socket = ends[0];
}

static void finish(struct usb_device *device, uint32_t number, int status, const void *data, size_t size,
                   size_t transferred) {
    struct message message = {.command = htonl(RET_SUBMIT), .number = htonl(number)};
    message.done.status = htonl((uint32_t)status);
    message.done.length = htonl((uint32_t)transferred);
    put(device->socket, &message, sizeof(message));
    put(device->socket, data, size);
}

static uint32_t take_oldest(struct usb_device *device) {
    uint32_t number = device->pending[0].number;
    memmove(&device->pending[0], &device->pending[1], --device->pending_count * sizeof(device->pending[0]));
    return number;
}

bool usb_send(struct usb_device *device, const void *data, size_t size) {
    if (!device->pending_count)
        return false;
    finish(device, take_oldest(device), 0, data, size, size);
    return true;
}

void usb_stall(struct usb_device *device) {
    if (device->pending_count)
        finish(device, take_oldest(device), -EPIPE, NULL, 0, 0);
}

static void serve_control(struct usb_device *device, const struct message *message) {
    const uint8_t *s = message->submit.setup;
    const struct usb_request request = {s[0], s[1], (uint16_t)(s[2] | s[3] << 8), (uint16_t)(s[4] | s[5] << 8),
                                        (uint16_t)(s[6] | s[7] << 8)};
    uint8_t data[512] = {0};
    bool in = request.type & 0x80;
    if (!in && request.length)
        get(device->socket, data, request.length < sizeof(data) ? request.length : sizeof(data));
    int length = device->control(&request, data);
    if (length > request.length)
        length = request.length;
    if (length == USB_NO_ANSWER)
        device->unanswered[device->unanswered_count++ % USB_PENDING] = ntohl(message->number);
    else if (length < 0)
        finish(device, ntohl(message->number), -EPIPE, NULL, 0, 0); /* stalled */
    else
        finish(device, ntohl(message->number), 0, data, in ? (size_t)length : 0, in ? (size_t)length : request.length);
}

static void answer_unlink(struct usb_device *device, uint32_t by, bool taken_back) {
    struct message answer = {.command = htonl(RET_UNLINK), .number = htonl(by)};
    if (taken_back)
        answer.unlink = htonl((uint32_t)-104); /* ECONNRESET: before it was done */
    put(device->socket, &answer, sizeof(answer));
}

static bool was_unanswered(const struct usb_device *device, uint32_t number) {
    for (unsigned i = 0; i < USB_PENDING; i++)
        if (number && device->unanswered[i] == number)
            return true;
    return false;
}

/* Transfers are requested in the order of their numbers, but vhci_hcd may cancel one before requesting it, since it
 * sends all waiting messages of one kind, then of the other. If we answered that we do not know the transfer, it would
 * complete it, and unplug us for the later answer. */
static void serve_unlink(struct usb_device *device, const struct message *message) {
    uint32_t number = ntohl(message->unlink), by = ntohl(message->number);
    for (unsigned i = 0; i < device->pending_count; i++) {
        if (device->pending[i].number != number)
            continue;
        device->pending_count--;
        memmove(&device->pending[i], &device->pending[i + 1], (device->pending_count - i) * sizeof(device->pending[0]));
        answer_unlink(device, by, true);
        return;
    }
    if (number <= device->newest) {
        answer_unlink(device, by, was_unanswered(device, number));
        return;
    }
    if (device->early_count == USB_PENDING)
        fail("too many taken back");
    device->early[device->early_count].number = number;
    device->early[device->early_count++].by = by;
}

static bool was_taken_back(struct usb_device *device) {
    for (unsigned i = 0; i < device->early_count; i++) {
        if (device->early[i].number != device->newest)
            continue;
        answer_unlink(device, device->early[i].by, true);
        device->early[i] = device->early[--device->early_count];
        return true;
    }
    return false;
}

static void serve_message(struct usb_device *device) {
    struct message message;
    get(device->socket, &message, sizeof(message));
    if (ntohl(message.command) == CMD_UNLINK) {
        serve_unlink(device, &message);
        return;
    }
    device->newest = ntohl(message.number);
    if (!message.endpoint) {
        serve_control(device, &message);
        (void)was_taken_back(device); /* already done */
    } else if (was_taken_back(device)) {
        return;
    } else if (device->pending_count < USB_PENDING) {
        device->pending[device->pending_count].number = ntohl(message.number);
        device->pending[device->pending_count++].length = ntohl(message.submit.length);
    } else {
        fail("too many transfers");
    }
}

void usb_serve(struct usb_device *device, long ms, bool until_pending) {
    int64_t end = now_ms() + ms;
    for (;;) {
        int64_t left = end - now_ms();
        struct pollfd look = {.fd = device->socket, .events = POLLIN};
        if (left < 0 || (until_pending && device->pending_count))
            return;
        if (poll(&look, 1, (int)left) > 0)
            serve_message(device);
    }
}
