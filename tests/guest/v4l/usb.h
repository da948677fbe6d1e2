/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A simulated USB device: a socket to the kernel's vhci_hcd is the cable (the USB/IP protocol), so the real driver for
 * its class talks to it. When the process exits, the device is unplugged.
 */
#ifndef USB_H
#define USB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define USB_PENDING 64
#define USB_NO_ANSWER (-2)

struct usb_request {
    uint8_t type, request;
    uint16_t value, index, length;
};

struct usb_device {
    /* Answers a control request: fills `data` (at most 512 bytes) or reads it. Returns the length, -1 to
     * refuse, or USB_NO_ANSWER: the host waits until it gives up. */
    int (*control)(const struct usb_request *request, uint8_t *data);
    int socket;
    /* Transfers of the IN endpoint that the host waits for, oldest first. */
    struct {
        uint32_t number, length;
    } pending[USB_PENDING];
    unsigned pending_count;
    /* Control requests that get no answer. */
    uint32_t unanswered[USB_PENDING];
    unsigned unanswered_count;
    uint32_t newest; /* number of the latest requested transfer */
    /* Transfers cancelled before they were requested, and the host's messages that did so. */
    struct {
        uint32_t number, by;
    } early[USB_PENDING];
    unsigned early_count;
};

/* Plug it in. */
void usb_plug(struct usb_device *device, unsigned port);

/* Serve the host for at most `ms`, or until another transfer is waiting. */
void usb_serve(struct usb_device *device, long ms, bool until_pending);

/* Complete the oldest waiting transfer with these bytes. False if there is none. */
bool usb_send(struct usb_device *device, const void *data, size_t size);

/* Refuse the oldest waiting transfer: the endpoint stalls. */
void usb_stall(struct usb_device *device);

#endif
