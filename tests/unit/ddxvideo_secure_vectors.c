/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Encrypted packets byte by byte: those of an independent program are decrypted, ours are equal. The SDP lines. */
#include "bits.h"
#include "ddxvideo_secure.h"

/*
 * Bytes from Python's cryptography (AES-CTR) and hmac, by RFC 3711, which derive the session keys of B.3. The first
 * packet is also libsrtp2's own test vector.
 */
static const char vector_plain[] = "800f1234decafbadcafebabe4e55dc4ce79978d88ca4d215949d2402b78d6acc99ea179b8dbb";
static const char vector_counter[] = "90e01238decafbadcafebabebede00024200000522000719"
                                     "ecb1b5f9e874de9c61a7144aee6e81e8c981c28580151a5c47ad3904f398";
static const char plain_counter[] = "90e01238decafbadcafebabebede000122000719"
                                    "4142434445464748494a4b4c4d4e4f5051525354";
static const char vector_report[] = "81ce00020102030488589f5a80000001c4d11be9616873f4f221";
static const char plain_report[] = "81ce000201020304cafebabe";

static void fill(struct packet *packet, const char *digits) {
    for (packet->size = 0; *digits; digits += 2)
        CHECK(sscanf(digits, "%2hhx", packet->data + packet->size++) == 1);
}

static void check_is(const struct packet *packet, const char *digits) {
    struct packet wanted;

    fill(&wanted, digits);
    CHECK(packet->size == wanted.size && !memcmp(packet->data, wanted.data, wanted.size));
}

static void test_vectors_in(void) {
    struct secure *receiver = secure_with(KEY);
    struct packet packet;

    fill(&packet, vector_plain);
    CHECK_EQUAL(secure_unprotect(receiver, packet.data, &packet.size), 0);
    CHECK_EQUAL(packet.size, 12 + 16);
    for (size_t i = 12; i < packet.size; i++)
        CHECK_EQUAL(packet.data[i], 0xab);
    fill(&packet, vector_counter); /* of the same source, five wraps later */
    CHECK_EQUAL(secure_unprotect(receiver, packet.data, &packet.size), 0);
    check_is(&packet, plain_counter);
    fill(&packet, vector_report);
    CHECK_EQUAL(secure_unprotect_report(receiver, packet.data, &packet.size), 0);
    check_is(&packet, plain_report);
    secure_close(receiver);
}

static void test_vectors_out(void) {
    struct secure *sender = secure_with(KEY);
    struct packet packet;

    for (uint32_t index = 1; index < 5u << 16; index += 30000) { /* five wraps */
        fill(&packet, plain_counter);
        put16(packet.data + 2, (uint16_t)index);
        CHECK_EQUAL(secure_protect(sender, packet.data, &packet.size), 0);
    }
    fill(&packet, plain_counter);
    CHECK_EQUAL(secure_protect(sender, packet.data, &packet.size), 0);
    check_is(&packet, vector_counter);
    fill(&packet, plain_report);
    CHECK_EQUAL(secure_protect_report(sender, packet.data, &packet.size), 0);
    check_is(&packet, vector_report);
    secure_close(sender);
}

static void test_description(void) {
    struct secure *secure = secure_with(KEY);
    char text[SECURE_SDP_MAX];

    CHECK_EQUAL(secure_sdp(secure, text), strlen(text));
    CHECK(!strcmp(text, "a=crypto:1 AES_CM_128_HMAC_SHA1_80 inline:4fl6DT4Bi+DWT6MsBt5BOQ7Gda1Jiv7rtpYLOqvm\r\n"
                        "a=extmap:4 urn:ddxvideo:rollover\r\n"));
    secure_close(secure);
    secure_close(NULL);
}

int main(void) {
    scratch_make();
    test_vectors_in();
    test_vectors_out();
    test_description();
    return 0;
}
