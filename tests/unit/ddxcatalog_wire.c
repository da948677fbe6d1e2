/* SPDX-License-Identifier: GPL-2.0-or-later */
/* What a message looks like on the network: its description, its hash, its bytes; and messages that are none. */
#include "bucket.h"
#include "check.h"
#include "envelope.h"
#include "name.h"
#include "offset.h"
#include "sha256.h"
#include "typehash.h"

#include <errno.h>

static void test_sha256(void) {
    static const struct {
        size_t size;
        uint8_t first, last;
    } cases[] = {{0, 0xe3, 0x55},  {3, 0x98, 0xf0},  {55, 0x9f, 0x18},
                 {56, 0xb3, 0x8a}, {64, 0xff, 0xeb}, {119, 0x31, 0xfb}};
    char text[119];
    uint8_t digest[SHA256_BYTES];

    memset(text, 'a', sizeof text);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sha256(text, cases[i].size, digest);
        CHECK_EQUAL(digest[0], cases[i].first);
        CHECK_EQUAL(digest[31], cases[i].last);
    }
}

/* The hash that ROS 2 itself has for this message. */
static void test_the_hash_of_a_standard_message(void) {
    struct description *description;
    char hash[TYPEHASH_MAX];

    CHECK_EQUAL(description_parse("std_msgs/msg/Header",
                                  "builtin_interfaces/Time stamp\nstring frame_id\n===\n"
                                  "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
                                  &description), 0);
    CHECK_EQUAL(typehash(description, hash), 0);
    CHECK(!strcmp(hash, "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"));
    description_free(description);
}

/* The one that PyPI's rosbags 0.11 computes for the same definition. */
static void test_the_hash_of_an_item(void) {
    struct description *description;
    struct form *form;
    char hash[TYPEHASH_MAX];

    CHECK_EQUAL(form_of_text("SENSOR", "struct { int32_t number; char name[5]; struct { double x; int16_t a[3]; } "
                                       "part[2]; float f; uint8_t last; }", "", &form), 0);
    CHECK_EQUAL(envelope_describe(form, &description), 0);
    CHECK_EQUAL(typehash(description, hash), 0);
    CHECK(!strcmp(hash, "RIHS01_35400aa0781f36e2ec6a2f41d72241f4475074a0ef8daf1d6ed37e8b0f6f3426"));
    description_free(description);
    form_free(form);
}

static void test_names(void) {
    char topic[NAME_TOPIC], type[NAME_TYPE];

    name_topic("robot-1", "video.frame", topic);
    CHECK(!strcmp(topic, "rt/robot_1/video_frame"));
    name_topic("9", "__x..y", topic);
    CHECK(!strcmp(topic, "rt/n9/n_x_y"));
    name_type("ddx/SENSORWheel", type);
    CHECK(!strcmp(type, "ddx::msg::dds_::SENSORWheel_"));
    CHECK(name_is_machine("carol") && name_is_machine("r2-d2"));
    CHECK(!name_is_machine("") && !name_is_machine("a b") && !name_is_machine("a/b") && !name_is_machine("a:b"));
    CHECK(!name_is_machine("a234567890123456789012345678901234"));
    CHECK(name_meets("robot-1", "robot_1") && !name_meets("robot-1", "robot-2"));
    name_distinguish("a2345678901234567890123456789012", 0x123456789, type);
    CHECK(!strcmp(type, "a23456789012345678901234567-6789") && name_is_machine(type));
}

/* In ten seconds: large messages get what small ones leave, and both together not more than is allowed. */
static void test_the_bucket(void) {
    enum { rate = 100000, large = 50000, small = 400 };
    struct bucket bucket;
    size_t sent[2] = {0, 0};

    bucket_begin(&bucket, rate, 0);
    for (int64_t ms = 0; ms < 10000; ms++) {
        if (bucket_take(&bucket, large, ms * 1000000))
            sent[0] += large;
        if (ms % 10 == 0) { /* 40 % of the rate, and with what each packet has beside them 50 % */
            CHECK(bucket_take(&bucket, small, ms * 1000000));
            sent[1] += small;
        }
    }
    CHECK_EQUAL(sent[1], 1000 * small);
    CHECK(sent[0] > 4 * rate && sent[0] < 6 * rate);
    for (int i = 0; i < 100; i++)
        bucket_take(&bucket, small, INT64_C(10000000000));
    CHECK(!bucket_take(&bucket, small, INT64_C(10000000000)));
    CHECK(!bucket_take(&bucket, large, INT64_C(10000000000)));
    bucket_begin(&bucket, 0, 0);
    CHECK(bucket_take(&bucket, 1 << 24, 0) && bucket_take(&bucket, 1 << 24, 0));
}

/* The other clock is 5000 s ahead; what is slow on one way only is half of it off, and the bound says so. */
static void test_the_offset_of_a_clock(void) {
    const int64_t ms = 1000000, s = 1000 * ms, ahead = 5000 * s;
    struct offset offset = {.count = 0};
    int64_t apart, bound;

    CHECK(!offset_get(&offset, s, &apart, &bound));
    CHECK(offset_add(&offset, s, s + ahead + 9 * ms, s + ahead + 10 * ms, s + 11 * ms));
    CHECK(offset_get(&offset, s + 11 * ms, &apart, &bound));
    CHECK_EQUAL(apart, ahead + 4 * ms);
    CHECK_EQUAL(bound, 5 * ms + ms / 10000);
    CHECK(offset_add(&offset, 2 * s, 2 * s + ahead + ms, 2 * s + ahead + ms, 2 * s + 2 * ms));
    CHECK(offset_get(&offset, 3 * s + 2 * ms, &apart, &bound));
    CHECK_EQUAL(apart, ahead);
    CHECK_EQUAL(bound, ms + s / 10000);
    for (int i = 0; i < OFFSET_SAMPLES; i++) /* the best one is too old at last */
        CHECK(offset_add(&offset, 4 * s, 4 * s - ahead + ahead + 2 * ms, 4 * s + 2 * ms, 4 * s + 4 * ms));
    CHECK(offset_get(&offset, 5 * s, &apart, &bound));
    CHECK_EQUAL(apart, 0);
    CHECK(!offset_add(&offset, s, s, s, s - 1));                 /* came before it was sent */
    CHECK(!offset_add(&offset, s, s, s + 2 * ms, s + ms));       /* was there longer than away */
    CHECK(!offset_add(&offset, INT64_MIN, s, s, s));
    CHECK(!offset_add(&offset, s, s, INT64_MAX, s));
}

static const char declaration[] = "struct { int8_t sequence; double x; int16_t a[3]; }";

struct value {
    int8_t sequence;
    double x;
    int16_t a[3];
};

/* The form of a value in memory, as form_of_item() would make it: that of the message, with the item's places. */
static struct form *form_of_value(void) {
    struct form *form;

    CHECK_EQUAL(form_of_text("V", declaration, "", &form), 0);
    return form;
}

static void test_a_field_that_is_called_as_one_of_ours(void) {
    struct form *form = form_of_value();
    struct description *description;

    CHECK_EQUAL(envelope_describe(form, &description), 0);
    const struct description_message *message = description_find(description, "ddx/V");
    CHECK(message && message->count == 6);
    CHECK(!strcmp(message->fields[0].type, "std_msgs/Header") && !strcmp(message->fields[1].name, "sequence"));
    CHECK(!strcmp(message->fields[3].name, "sequence_again2"));
    CHECK_EQUAL(message->fields[5].count, 3);
    description_free(description);
    form_free(form);
}

static void test_a_message_and_what_is_none(void) {
    struct form *form = form_of_value();
    const struct envelope sent = {"carol", 7, 1700000000123456789, 42};
    unsigned char message[256] = {0};
    struct envelope got;

    unsigned char *fields = envelope_write(&sent, message);
    CHECK_EQUAL(fields - message, envelope_size("carol"));
    CHECK_EQUAL((fields - message - FORM_HEADER) % 8, 0);
    size_t size = envelope_size("carol") + form->message_size - FORM_HEADER;
    CHECK(envelope_read(form, message, size, &got) == fields);
    CHECK_EQUAL(got.sequence, 7);
    CHECK_EQUAL(got.wall, sent.wall);
    CHECK_EQUAL(got.monotonic, 42);
    for (size_t wrong = 0; wrong < sizeof message; wrong++)
        CHECK(wrong == ((size + 3) & ~(size_t)3) || wrong == size || wrong == size + 1 ||
              !envelope_read(form, message, wrong, &got));
    for (unsigned length = 0; length < 256; length++) {
        memset(message + 12, (int)length, 4); /* of the machine's name */
        CHECK(!envelope_read(form, message, size, &got));
    }
    form_free(form);
}

static void test_what_cannot_be_described(void) {
    static const char *const bad[] = {"", "int8\n", "ddx/Missing a\n", "int8 a\nMSG: ddx/Empty\n"};
    struct description *description;

    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        CHECK_EQUAL(description_parse("ddx/msg/T", bad[i], &description), -EINVAL);
}

int main(void) {
    test_sha256();
    test_the_hash_of_a_standard_message();
    test_the_hash_of_an_item();
    test_names();
    test_the_bucket();
    test_the_offset_of_a_clock();
    test_a_field_that_is_called_as_one_of_ours();
    test_a_message_and_what_is_none();
    test_what_cannot_be_described();
    return 0;
}
