/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Announcements by RFC 2974 and their descriptions: bytes, those of other senders, and refused ones. */
#include "sdp.h"

#include "check.h"

#define SDP                                                                                    \
    "v=0\r\no=- 7 1 IN IP4 10.0.0.1\r\ns=robot1 video\r\nc=IN IP4 239.255.20.5/1\r\nt=0 0\r\n" \
    "m=video 8000 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"

static struct sap example(const char *origin, const char *text) {
    struct sap sap = {.hash = 0x1234, .text = (const uint8_t *)text, .size = strlen(text)};
    CHECK(network_parse(origin, 1, &sap.origin));
    network_set_port(&sap.origin, 0);
    return sap;
}

/* RFC 2974, 6: figure 1. */
static void test_bytes(void) {
    static const uint8_t head[] = {0x20, 0, 0x12, 0x34, 10, 0, 0, 1, 'a', 'p', 'p'};
    uint8_t data[SAP_MAX];
    struct sap sap = example("10.0.0.1", SDP);
    CHECK_EQUAL(sap_write(&sap, data), 8 + 16 + sizeof SDP - 1);
    CHECK(!memcmp(data, head, sizeof head) && !memcmp(data + 8, "application/sdp", 16));
    CHECK(!memcmp(data + 24, SDP, sizeof SDP - 1));
    sap.deletion = true;
    sap_write(&sap, data);
    CHECK_EQUAL(data[0], 0x24);
    sap = example("fd00::1", SDP);
    CHECK_EQUAL(sap_write(&sap, data), 20 + 16 + sizeof SDP - 1);
    CHECK_EQUAL(data[0], 0x30);
    CHECK_EQUAL(data[4], 0xfd);
}

static void test_round_trip(void) {
    static const char *const origins[] = {"10.0.0.1", "fd00::1"};
    for (unsigned i = 0; i < 4; i++) {
        uint8_t data[SAP_MAX];
        struct sap sap = example(origins[i % 2], i < 2 ? SDP : "o=- 7 1 IN IP4 10.0.0.1\r\n"), got;
        char text[2][NETWORK_TEXT_MAX];
        sap.deletion = i >= 2;
        CHECK(sap_parse(data, sap_write(&sap, data), &got));
        CHECK_EQUAL(got.hash, 0x1234);
        CHECK_EQUAL(got.deletion, sap.deletion);
        CHECK(got.size == sap.size && !memcmp(got.text, sap.text, sap.size));
        CHECK(!strcmp(network_text(&got.origin, text[0]), network_text(&sap.origin, text[1])));
    }
}

static void test_size(void) {
    static char text[SAP_MAX + 1];
    uint8_t *data = malloc(SAP_MAX);
    memset(text, 'x', SAP_MAX - 24);
    memcpy(text, "v=0", 3);
    struct sap sap = example("10.0.0.1", text);
    CHECK_EQUAL(sap_write(&sap, data), SAP_MAX);
    sap.size++;
    CHECK_EQUAL(sap_write(&sap, data), 0);
    free(data);
}

/* Parses a copy of exactly this size, so that a sanitizer sees a read beyond it. */
static bool parses(const void *data, size_t size, struct sap *sap) {
    static uint8_t *copy;
    free(copy);
    copy = malloc(size ? size : 1);
    memcpy(copy, data, size);
    return sap_parse(copy, size, sap);
}

/* Announcements of other senders. */
static void test_others(void) {
    struct sap sap;
    CHECK(parses("\x20\0\0\1\x0a\0\0\1v=0\n", 12, &sap) && sap.size == 4);         /* no type */
    CHECK(parses("\x20\2\0\1\x0a\0\0\1AUTHENTIv=0\n", 20, &sap) && sap.size == 4); /* authentication */
    CHECK(parses("\x24\0\0\1\x0a\0\0\1", 8, &sap) && sap.deletion && !sap.size);
    CHECK(parses("\x24\0\0\1\x0a\0\0\1o=- 7", 13, &sap) && sap.deletion);
    CHECK(parses("\x28\0\0\1\x0a\0\0\1v=0\n", 12, &sap)); /* the reserved bit is ignored */
}

static void test_refused(void) {
    struct sap sap;
    CHECK(!parses("\x00\0\0\1\x0a\0\0\1v=0\n", 12, &sap)); /* version 0 */
    CHECK(!parses("\x40\0\0\1\x0a\0\0\1v=0\n", 12, &sap));
    CHECK(!parses("\x22\0\0\1\x0a\0\0\1v=0\n", 12, &sap));   /* encrypted */
    CHECK(!parses("\x21\0\0\1\x0a\0\0\1v=0\n", 12, &sap));   /* compressed */
    CHECK(!parses("\x20\xff\0\1\x0a\0\0\1v=0\n", 12, &sap)); /* authentication beyond the end */
    CHECK(!parses("\x20\0\0\1\x0a\0\0\1text/plain\0v=0\n", 23, &sap));
    CHECK(!parses("\x20\0\0\1\x0a\0\0\1o=- 7", 13, &sap)); /* an announcement has a whole description */
    CHECK(!parses("\x20\0\0\1\x0a\0\0\1", 8, &sap));
    CHECK(!parses("\x20\0\0\1\x0a\0\0\1application/sdp\0", 24, &sap));
    CHECK(!parses("\x20\0\0\1\x0a\0\0\1v=0\0\n", 13, &sap));
    CHECK(!parses("\x20\0\0\1\0\0\0\0v=0\n", 12, &sap)); /* no origin */
    for (size_t i = 0; i < 8; i++)
        CHECK(!parses("\x24\0\0\1\x0a\0\0\1", i, &sap));
    for (size_t i = 0; i < 20; i++)
        CHECK(!parses("\x34\0\0\1\x0a\0\0\1\0\0\0\0\0\0\0\0\0\0\0\0", i, &sap));
}

static void is_announced_at(const char *stream, const char *wanted) {
    struct network_address from, group;
    char text[NETWORK_TEXT_MAX];
    CHECK(network_parse(stream, 8000, &from));
    sap_group(&from, &group);
    if (strcmp(network_text(&group, text), wanted)) {
        fprintf(stderr, "%s is announced at %s, not at %s\n", stream, text, wanted);
        exit(1);
    }
}

static void test_group(void) {
    is_announced_at("239.255.20.5", "239.255.255.255:9875");
    is_announced_at("239.192.0.1", "239.195.255.255:9875");
    is_announced_at("239.195.255.1", "239.195.255.255:9875");
    is_announced_at("239.196.0.1", "224.2.127.254:9875");
    is_announced_at("224.2.128.1", "224.2.127.254:9875");
    is_announced_at("224.0.0.9", "224.0.0.255:9875");
    is_announced_at("ff15::5", "[ff05::2:7ffe]:9875");
    is_announced_at("ff02::5%eth0", "[ff02::2:7ffe%eth0]:9875");
    is_announced_at("ff3e::8000:1", "[ff0e::2:7ffe]:9875");
}

static void test_hash(void) {
    uint16_t hash = sap_hash((const uint8_t *)SDP, sizeof SDP - 1);
    CHECK(hash && hash != sap_hash((const uint8_t *)SDP, sizeof SDP - 2) && sap_hash(NULL, 0));
}

static struct sdp_stream read_sdp(const char *text) {
    struct sdp_stream stream;
    CHECK(sdp_read((const uint8_t *)text, strlen(text), &stream));
    return stream;
}

static bool is_refused(const char *text) {
    struct sdp_stream stream;
    return !sdp_read((const uint8_t *)text, strlen(text), &stream);
}

static void test_description(void) {
    char text[NETWORK_TEXT_MAX];
    struct sdp_stream stream = read_sdp(SDP);
    CHECK(!strcmp(stream.name, "robot1 video") && !strcmp(stream.codec, "H264"));
    CHECK(!strcmp(network_text(&stream.address, text), "239.255.20.5:8000"));
    stream = read_sdp("s=\x1b[2Jx\nc=IN IP6 ff15::5\nm=video 8004/2 RTP/AVP 33");
    CHECK(!strcmp(stream.name, "?[2Jx") && !strcmp(stream.codec, "MPEG-TS"));
    CHECK(!strcmp(network_text(&stream.address, text), "[ff15::5]:8004"));
    /* Audio before it, another video after it, each with its own address. */
    stream = read_sdp("s=a\nm=audio 1 RTP/AVP 0\nc=IN IP4 10.0.0.1\nm=video 2 RTP/AVP 96\nc=IN IP4 10.0.0.2\n"
                      "a=rtpmap:97 VP8/90000\na=rtpmap:96 H264/90000\nm=video 4 RTP/AVP 96\nc=IN IP4 10.0.0.4\n");
    CHECK(!strcmp(network_text(&stream.address, text), "10.0.0.2:2") && !strcmp(stream.codec, "H264"));
}

static void test_no_description(void) {
    CHECK(is_refused(""));
    CHECK(is_refused("s=a\nc=IN IP4 10.0.0.1\nm=audio 1 RTP/AVP 0\n"));
    CHECK(is_refused("s=a\nm=video 1 RTP/AVP 96\n"));
    CHECK(is_refused("c=IN IP4 robot\nm=video 1 RTP/AVP 96\n"));
    CHECK(is_refused("c=IN IP6 10.0.0.1\nm=video 1 RTP/AVP 96\n"));
    CHECK(is_refused("c=IN IP6 fe80::1%eth0\nm=video 1 RTP/AVP 96\n"));
    CHECK(is_refused("c=IN IP4 10.0.0.1\nm=video 0 RTP/AVP 96\n"));
    CHECK(is_refused("c=IN IP4 10.0.0.1\nm=video -1 RTP/AVP 96\n"));
    CHECK(is_refused("c=IN IP4 10.0.0.1\nm=video 99999 RTP/AVP 96\n"));
    CHECK(is_refused("c=IN IP4 10.0.0.1\nm=video 1 RTP/AVP 128\n"));
    CHECK(is_refused("c=IN IP4 10.0.0.1\nm=video 1 RTP/AVP -1\n"));
}

int main(void) {
    test_bytes();
    test_round_trip();
    test_size();
    test_others();
    test_refused();
    test_group();
    test_hash();
    test_description();
    test_no_description();
    return 0;
}
