/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Messages on the network: description, hash, bytes; and invalid messages. */
#include "bucket.h"
#include "check.h"
#include "envelope.h"
#include "name.h"
#include "standard.h"
#include "description.h"

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

/* ROS 2's own hash of this message. */
static void test_the_hash_of_a_standard_message(void) {
    struct description *description;
    char hash[TYPEHASH_MAX];

    CHECK_EQUAL(description_parse("std_msgs/msg/Header",
                                  "builtin_interfaces/Time stamp\nstring frame_id\n===\n"
                                  "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
                                  &description),
                0);
    CHECK_EQUAL(typehash(description, hash), 0);
    CHECK(!strcmp(hash, "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"));
    description_free(description);
}

/* The hash that PyPI's rosbags 0.11 computes for the same definition. */
static void test_the_hash_of_an_item(void) {
    struct description *description;
    struct form *form;
    char hash[TYPEHASH_MAX];

    CHECK_EQUAL(form_of_text("SENSOR",
                             "struct { int32_t number; char name[5]; struct { double x; int16_t a[3]; } "
                             "part[2]; float f; uint8_t last; }",
                             "", &form),
                0);
    CHECK_EQUAL(envelope_describe(form, &description), 0);
    CHECK_EQUAL(typehash(description, hash), 0);
    CHECK(!strcmp(hash, "RIHS01_35400aa0781f36e2ec6a2f41d72241f4475074a0ef8daf1d6ed37e8b0f6f3426"));
    description_free(description);
    form_free(form);
}

/* The hashes of ROS 2 Jazzy. */
static void test_the_hashes_of_the_messages_that_are_known(void) {
    static const struct {
        const char *type, *hash;
    } cases[] = {
        {"builtin_interfaces/Time", "b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197"},
        {"std_msgs/Int8", "26525065a403d972cb672f0777e333f0c799ad444ae5fcd79e43d1e73bd0f440"},
        {"std_msgs/Int16", "1dcc3464e47c288a55f943a389d337cdb06804de3f5cd7a266b0de718eee17e5"},
        {"std_msgs/Int32", "b6578ded3c58c626cfe8d1a6fb6e04f706f97e9f03d2727c9ff4e74b1cef0deb"},
        {"std_msgs/Int64", "8cd1048c2f186b6bd9a92472dc1ce51723c0833a221e2b7aecfff111774f4b49"},
        {"std_msgs/UInt8", "6138bd83d8c3569cb80a667db03cfc1629f529fee79d944c39c34e352e72f010"},
        {"std_msgs/UInt16", "08a406e4b022bc22e907f985d6a9e9dd1d4fbecae573549cf49350113e7757b1"},
        {"std_msgs/UInt32", "a5c874829b752bc5fa190024b0ad76f578cc278271e855c7d02a818b3516fb4a"},
        {"std_msgs/UInt64", "fbdc52018fc13755dce18024d1a671c856aa8b4aaf63adfb095b608f98e8c943"},
        {"std_msgs/Float32", "7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2"},
        {"std_msgs/Float64", "705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a"},
        {"std_msgs/ColorRGBA", "77a7a5b9ae477306097665106e0413ba74440245b1f3d0c6d6405fe5c7813fe8"},
        {"geometry_msgs/Vector3", "cc12fe83e4c02719f1ce8070bfd14aecd40f75a96696a67a2a1f37f7dbb0765d"},
        {"geometry_msgs/Vector3Stamped", "d4829622288cbb443886e7ea94ea5671a3b1be6bab4ad04224432a65f7d7887a"},
        {"geometry_msgs/Point", "6963084842a9b04494d6b2941d11444708d892da2f4b09843b9c43f42a7f6881"},
        {"geometry_msgs/PointStamped", "4c0296af86e01e562e9e0405d138a01537247580076c58ea38d7923ac1045897"},
        {"geometry_msgs/Quaternion", "8a765f66778c8ff7c8ab94afcc590a2ed5325a1d9a076ffff38fbce36f458684"},
        {"geometry_msgs/QuaternionStamped", "381add86c6c3160644d228ca342182c7fd6c7fab11c7a85ad817a9cc22dbac6e"},
        {"geometry_msgs/Pose", "d501954e9476cea2996984e812054b68026ae0bfae789d9a10b23daf35cc90fa"},
        {"geometry_msgs/PoseStamped", "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"},
        {"geometry_msgs/PoseWithCovariance", "9a7c0fd234b7f45c6098745ecccd773ca1085670e64107135397aee31c02e1bb"},
        {"geometry_msgs/PoseWithCovarianceStamped", "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e"},
        {"geometry_msgs/Twist", "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"},
        {"geometry_msgs/TwistStamped", "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"},
        {"geometry_msgs/TwistWithCovariance", "49f574f033f095d8b6cd1beaca5ca7925e296e84af1716d16c89d38b059c8c18"},
        {"geometry_msgs/TwistWithCovarianceStamped",
         "77b67434531e6529b7a0091357b186b6ebdb17fd9ffd3e0c7ce9d3fb11a44563"},
        {"geometry_msgs/Accel", "dc448243ded9b1fcbcca24aba0c22f013dae06c354ba2d849571c0a2a3f57ca0"},
        {"geometry_msgs/AccelStamped", "ef1df9eabae0a708cc049a061ebcddc4e2a5f745730100ba680e086a9698b165"},
        {"geometry_msgs/Wrench", "018e8519d57c16adbe97c9fe1460ef21fec7e31bc541de3d653a35895677ce52"},
        {"geometry_msgs/WrenchStamped", "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"},
        {"geometry_msgs/Transform", "beb83fbe698636351461f6f35d1abb20010c43d55374d81bd041f1ba2581fddc"},
        {"sensor_msgs/Imu", "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"},
        {"sensor_msgs/Image", "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"},
        {"sensor_msgs/MagneticField", "e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff"},
        {"sensor_msgs/NavSatStatus", "d1ed3befa628e09571bd273b888ba1c1fd187c9a5e0006b385d7e5e9095a3204"},
        {"sensor_msgs/NavSatFix", "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404"},
        {"sensor_msgs/Temperature", "72514a14126ab9f8a9abec974c78e5610a367b59db5da355ff1fb982d5bad4b8"},
        {"sensor_msgs/FluidPressure", "22dfb2b145a0bd5a31a1ac3882a1b32148b51d9b2f3bab250290d66f3595bc32"},
        {"sensor_msgs/RelativeHumidity", "8687c99b4fb393cb2e545e407b5ea7fd0b5d8960bcd849a0f86c544740138839"},
        {"sensor_msgs/Illuminance", "b954b25f452fcf81a91c9c2a7e3b3fd85c4c873d452aecb3cfd8fd1da732a22d"},
        {"sensor_msgs/Range", "b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a"},
        {"std_msgs/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct standard *standard;
        char hash[TYPEHASH_MAX], why[STANDARD_WHY];

        CHECK_EQUAL(standard_open(cases[i].type, NULL, &standard, why), 0);
        CHECK_EQUAL(typehash(standard->description, hash), 0);
        CHECK(!strcmp(hash + strlen("RIHS01_"), cases[i].hash));
        standard_close(standard);
    }
}

#define VECTOR "struct { double x; double y; double z; } "
#define QUATERNION "struct { double x; double y; double z; double w; } orientation; "

static void check_fit(const char *type, const char *declaration, int result, const char *told) {
    struct standard *standard;
    struct form *form;
    char why[STANDARD_WHY] = "";

    CHECK_EQUAL(form_of_text("ITEM", declaration, "", &form), 0);
    int error = standard_open(type, form, &standard, why);
    CHECK_EQUAL(error, result);
    CHECK(!strcmp(why, told));
    if (!error)
        standard_close(standard);
    form_free(form);
}

static void test_items_that_are_like_a_message(void) {
    check_fit("geometry_msgs/msg/Twist", "struct { " VECTOR "linear; " VECTOR "angular; }", 0, "");
    check_fit("geometry_msgs/msg/Twist", "struct { " VECTOR "linear; }", -EINVAL, "it lacks field angular");
    check_fit("geometry_msgs/msg/Twist", "struct { " VECTOR "linear; " VECTOR "angular; int8_t more; }", -EINVAL,
              "it has one more, field more");
    check_fit("geometry_msgs/msg/Twist", "struct { " VECTOR "linear; struct { double x; float y; } angular; }", -EINVAL,
              "its field angular.y is float32, not float64");
    check_fit("geometry_msgs/msg/Twist", "struct { " VECTOR "angular; " VECTOR "linear; }", -EINVAL,
              "instead of field linear it has angular");
    check_fit("sensor_msgs/msg/Temperature", "struct { double temperature; double variance; }", 0, "");
    check_fit("sensor_msgs/msg/Temperature", "struct { double temperature; double variance[2]; }", -EINVAL,
              "its field variance is float64[2], not float64");
    check_fit("sensor_msgs/msg/Nothing", "struct { double x; }", -ENOENT, "");
    check_fit("Imu", "struct { double x; }", -ENOENT, "");
    check_fit("", "struct { double x; }", -ENOENT, "");
    check_fit("geometry_msgs/msg/Pose", "struct { " VECTOR "position; " QUATERNION "}", 0, "");
}

/* A message of another length is refused. */
static void test_a_message_is_read_whole_or_not(void) {
    static const struct envelope envelope = {.machine = "robot", .wall = INT64_C(1700000000000000005)};
    static const char *const cases[][2] = {
        {"sensor_msgs/msg/NavSatStatus", "struct { int8_t status; uint16_t service; }"},
        {"std_msgs/msg/Int8", "int8_t"},
        {"sensor_msgs/msg/Range", "struct { uint8_t radiation_type; float field_of_view; float min_range; "
                                  "float max_range; float range; float variance; }"}};

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        unsigned char value[64], back[64] = {0}, message[128], exact[128];
        struct standard *standard;
        struct form *form;
        char why[STANDARD_WHY];

        CHECK_EQUAL(form_of_text("ITEM", cases[i][1], "", &form), 0);
        if (form->leaf_count == 1) /* a plain number is no struct with a field `data` */
            CHECK_EQUAL(standard_open(cases[i][0], form, &standard, why), -EINVAL);
        CHECK_EQUAL(standard_open(cases[i][0], form->leaf_count == 1 ? NULL : form, &standard, why), 0);
        for (size_t k = 0; k < form->leaf_count; k++) /* a text has no layout in the item: take the message's */
            form->leaves[k].item = form->leaves[k].message;
        for (size_t k = 0; k < sizeof value; k++)
            value[k] = (unsigned char)(k + 1);
        size_t size = standard_write(standard, form, &envelope, value, message);
        CHECK(size <= standard_size(standard, form, envelope.machine));
        for (size_t length = 0; length < sizeof message; length++) {
            unsigned char *copy = memcpy(exact + sizeof exact - length, message, length < size ? length : size);

            CHECK_EQUAL(standard_check(standard, form, copy, length), length >= size && length < size + 4);
        }
        standard_read(standard, form, message, back);
        for (size_t k = 0; k < form->leaf_count; k++)
            CHECK(!memcmp(back + form->leaves[k].item, value + form->leaves[k].item, form->leaves[k].bytes));
        message[1] = 0; /* big endian */
        CHECK(!standard_check(standard, form, message, size));
        message[1] = 1;
        message[FORM_HEADER + 11] = 0xff; /* length of the name */
        CHECK(!standard->has_header || !standard_check(standard, form, message, size));
        standard_close(standard);
        form_free(form);
    }
}

static void test_topics(void) {
    static const char *const good[] = {"/imu", "/imu/data", "/_a/b_c2", "/A"};
    static const char *const bad[] = {"", "/", "imu", "/imu/", "//imu", "/2", "/a__b", "/a-b", "/a b", "/a\n"};
    char topic[NAME_TOPIC + 1];

    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        CHECK(name_is_topic(good[i]));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        CHECK(!name_is_topic(bad[i]));
    memset(topic, 'a', sizeof topic);
    topic[0] = '/';
    topic[NAME_TOPIC] = 0;
    CHECK(!name_is_topic(topic));
    topic[NAME_TOPIC - 4] = 0;
    CHECK(name_is_topic(topic));
    CHECK(strlen("rt") + strlen(topic) < NAME_TOPIC);
}

static void test_names(void) {
    char topic[NAME_TOPIC], type[NAME_TYPE];

    name_topic("robot-1", "video.frame", topic);
    CHECK(!strcmp(topic, "rt/robot_1/video_frame"));
    name_topic("9", "__x..y", topic);
    CHECK(!strcmp(topic, "rt/n9/n_x_y"));
    name_number("rt/n9/a_b", 2, topic);
    CHECK(!strcmp(topic, "rt/n9/a_b_2"));
    name_number("rt/n9/n_", 13, topic);
    CHECK(!strcmp(topic, "rt/n9/n_13") && name_is_topic(topic + 2));
    name_type("ddx/SENSORWheel", type);
    CHECK(!strcmp(type, "ddx::msg::dds_::SENSORWheel_"));
    CHECK(name_is_machine("carol") && name_is_machine("r2-d2"));
    CHECK(!name_is_machine("") && !name_is_machine("a b") && !name_is_machine("a/b") && !name_is_machine("a:b"));
    CHECK(!name_is_machine("a234567890123456789012345678901234"));
    CHECK(name_meets("robot-1", "robot_1") && !name_meets("robot-1", "robot-2"));
    name_distinguish("a2345678901234567890123456789012", 0x123456789, type);
    CHECK(!strcmp(type, "a23456789012345678901234567-6789") && name_is_machine(type));
}

/* In ten seconds: large messages get the rest that small ones leave, and both together keep the limit. */
static void test_the_bucket(void) {
    enum { rate = 100000, large = 50000, small = 400 };
    struct bucket bucket;
    size_t sent[2] = {0, 0};

    bucket_begin(&bucket, rate, 0);
    for (int64_t ms = 0; ms < 10000; ms++) {
        if (bucket_take(&bucket, large, ms * 1000000))
            sent[0] += large;
        if (ms % 10 == 0) { /* 40 % of the rate, with the headers of each packet 50 % */
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
    CHECK(bucket_take_other(&bucket, 1 << 24, 0) && bucket_take_other(&bucket, 1 << 24, 0));
}

/* In ten seconds: packets without new values get half of the limit at most, and values what these leave. */
static void test_bytes_without_values(void) {
    enum { rate = 100000, size = 400, sent = 500 };
    struct bucket bucket;
    size_t values = 0, others = 0;

    bucket_begin(&bucket, rate, 0);
    for (int64_t ms = 0; ms < 10000; ms++) {
        if (bucket_take_other(&bucket, sent, ms * 1000000))
            others += sent;
        if (bucket_take(&bucket, size, ms * 1000000)) {
            bucket_correct(&bucket, size, sent);
            values += sent;
        }
    }
    CHECK(others > 4 * rate && others < 6 * rate);
    CHECK(values > 4 * rate && others + values < 11 * rate);
    for (int64_t ms = 10000; ms < 20000; ms++)
        if (bucket_take(&bucket, size, ms * 1000000)) { /* to three readers, or to none */
            bucket_correct(&bucket, size, ms & 1 ? 3 * sent : 0);
            others += ms & 1 ? 3 * sent : 0;
        }
    CHECK(others > 13 * rate && others < 17 * rate);
}

static const char declaration[] = "struct { int8_t sequence; double x; int16_t a[3]; }";

struct value {
    int8_t sequence;
    double x;
    int16_t a[3];
};

/* The form of a value in memory, as form_of_item() makes it: the message's form with the item's offsets. */
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
    test_the_hashes_of_the_messages_that_are_known();
    test_items_that_are_like_a_message();
    test_a_message_is_read_whole_or_not();
    test_topics();
    test_names();
    test_the_bucket();
    test_bytes_without_values();
    test_a_field_that_is_called_as_one_of_ours();
    test_a_message_and_what_is_none();
    test_what_cannot_be_described();
    return 0;
}
