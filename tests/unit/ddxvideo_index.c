/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Checksums by the RFC; an index is believed up to its first damage. */
#include <stdlib.h>

#include "check.h"
#include "crc32c.h"
#include "index.h"

#define FRAMES 100

static void test_sums(void) {
    /* RFC 3720, B.4, and the check value of the catalogue of CRCs */
    unsigned char bytes[32] = {0};
    CHECK_EQUAL(crc32c(0, "123456789", 9), 0xe3069283u);
    CHECK_EQUAL(crc32c(0, bytes, 32), 0x8a9136aau);
    memset(bytes, 0xff, sizeof(bytes));
    CHECK_EQUAL(crc32c(0, bytes, 32), 0x62a8ab43u);
    for (unsigned char i = 0; i < 32; i++)
        bytes[i] = i;
    CHECK_EQUAL(crc32c(0, bytes, 32), 0x46dd794eu);
    for (size_t cut = 0; cut <= 32; cut++) /* in two pieces, of any alignment */
        CHECK_EQUAL(crc32c(crc32c(0, bytes, cut), bytes + cut, 32 - cut), 0x46dd794eu);
}

static struct index_file *make(void) {
    struct index_file *index = calloc(1, sizeof(*index));
    index->header.state = INDEX_RECORDING;
    index->header.recording = 7;
    index_seal_header(&index->header);
    for (uint32_t i = 0; i < FRAMES; i++) {
        index->entry[i] = (struct index_entry){.recording = 7, .position = i, .offset = 100 + i * 50, .bytes = 50};
        index_seal_entry(&index->entry[i]);
    }
    return index;
}

static void test_count(void) {
    struct index_file *index = make();
    CHECK(index_good_header(&index->header));
    CHECK_EQUAL(index_count(index, UINT64_MAX), FRAMES);
    CHECK_EQUAL(index_count(index, 100 + 10 * 50), 10); /* the file is shorter */
    CHECK_EQUAL(index_count(index, 100 + 10 * 50 - 1), 9);
    CHECK_EQUAL(index_count(index, 0), 0);

    index->entry[40].recording = 8; /* a valid entry of an older recording */
    index_seal_entry(&index->entry[40]);
    CHECK_EQUAL(index_count(index, UINT64_MAX), 40);
    index->entry[30].offset += 50; /* a gap */
    index_seal_entry(&index->entry[30]);
    CHECK_EQUAL(index_count(index, UINT64_MAX), 30);
    index->entry[20].bytes = UINT32_MAX;
    index_seal_entry(&index->entry[20]);
    CHECK_EQUAL(index_count(index, 100 + FRAMES * 50), 20);
    free(index);
}

/* Each wrong bit is noticed. */
static void test_spoilt(void) {
    struct index_file *index = make();
    for (size_t bit = 0; bit < 8 * sizeof(struct index_entry); bit++) {
        unsigned char *byte = (unsigned char *)&index->entry[10] + bit / 8;
        *byte ^= (unsigned char)(1u << bit % 8);
        CHECK_EQUAL(index_count(index, UINT64_MAX), 10);
        *byte ^= (unsigned char)(1u << bit % 8);
    }
    for (size_t bit = 0; bit < 8 * sizeof(struct index_header); bit++) {
        unsigned char *byte = (unsigned char *)&index->header + bit / 8;
        *byte ^= (unsigned char)(1u << bit % 8);
        CHECK(!index_good_header(&index->header));
        *byte ^= (unsigned char)(1u << bit % 8);
    }
    free(index);
}

/* Former recorders did not write their instance; they had 128 bytes for the item, padded with zeros. */
static void test_former_layout(void) {
    struct index_header header = {.state = INDEX_NAMED, .number = 3};
    char *item = (char *)&header + 72;
    memcpy(item, "video", 6);
    memcpy(item + 128, "video-000003-20261122T155630Z.y4m", 34);
    index_seal_header(&header);
    CHECK(index_good_header(&header));
    CHECK(!strcmp(header.item, "video") && !*header.instance);
    CHECK(!strcmp(header.name, "video-000003-20261122T155630Z.y4m"));
    header.instance[sizeof(header.instance) - 1] = 'x';
    index_seal_header(&header);
    CHECK(!index_good_header(&header));
}

/* Root lists and copies recordings by the names in their indexes, which another user may have written. */
static void test_names(void) {
    static const char *const bad[] = {"../escape.y4m", "a/b.y4m", ".hidden", "line\nbreak", "\033[31mred", "\377"};
    struct index_header header = {.state = INDEX_FINISHED, .name = "video-000003-20261122T155630Z.y4m"};
    index_seal_header(&header);
    CHECK(index_good_header(&header));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        strcpy(header.name, bad[i]);
        index_seal_header(&header);
        CHECK(!index_good_header(&header));
    }
    strcpy(header.name, "video");
    strcpy(header.item, "\033[2J");
    index_seal_header(&header);
    CHECK(!index_good_header(&header));
}

int main(void) {
    test_sums();
    test_names();
    test_count();
    test_spoilt();
    test_former_layout();
    return 0;
}
