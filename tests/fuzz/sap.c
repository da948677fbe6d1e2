/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Fuzz target: an announcement of a stream (SAP) and its description (SDP). The input is one datagram. */
#include "sdp.h"

#include <assert.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* A message that is read and written again is the same. */
static void write_again(const struct sap *sap) {
    uint8_t message[SAP_MAX];
    struct sap same;
    size_t written = sap_write(sap, message);
    if (!written)
        return;
    assert(sap_parse(message, written, &same));
    assert(same.hash == sap->hash && same.deletion == sap->deletion && same.size == sap->size);
    assert(!memcmp(&same.origin, &sap->origin, sizeof same.origin) && !memcmp(same.text, sap->text, sap->size));
}

static void check_text(const char *text, size_t room) {
    size_t length = strnlen(text, room);
    assert(length < room);
    for (size_t i = 0; i < length; i++)
        assert(text[i] >= ' ' && text[i] < 127);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct sap sap;
    struct sdp_stream stream;
    char text[NETWORK_TEXT_MAX];
    if (!sap_parse(data, size, &sap))
        return 0;
    assert(!sap.size || (sap.text >= data && sap.text + sap.size <= data + size));
    assert(sap_hash(sap.text, sap.size));
    write_again(&sap);
    if (sdp_read(sap.text, sap.size, &stream)) {
        check_text(stream.name, sizeof stream.name);
        check_text(stream.codec, sizeof stream.codec);
        assert(network_port(&stream.address));
        check_text(network_text(&stream.address, text), sizeof text);
    }
    return 0;
}
