/* SPDX-License-Identifier: GPL-2.0-or-later */
/* MCAP written and read, also damaged: never a crash, never a message that was not written. */
#include "check.h"
#include "mcap.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#define MESSAGES 120
#define CHUNK 20
#define CHANNELS 3

static char path[64];

static size_t size_of(unsigned number) {
    return number * 7 % 90;
}

/* Every third message is 30 ms late: the order of times is not that of the file. */
static uint64_t time_of(unsigned number) {
    return 1000000 + number * UINT64_C(10) - (number % 3 ? 0 : 30);
}

static int write_file(void) {
    int fd = memfd_create("mcap", MFD_CLOEXEC);
    CHECK(fd >= 0);
    snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
    struct mcap_writer *writer = mcap_writer_new(fd);
    const struct mcap_pair pairs[] = {{"key", "value"}, {"other", ""}, {NULL, NULL}};
    const char text[] = "uint8 a\n";
    const struct mcap_schema schema = {1, "ddx/msg/A", "ros2msg", (const unsigned char *)text, strlen(text)};
    mcap_put_metadata(writer, "times", pairs);
    mcap_put_schema(writer, &schema);
    for (uint16_t id = 1; id <= CHANNELS; id++) {
        char topic[8];
        snprintf(topic, sizeof(topic), "t%u", id);
        const struct mcap_channel channel = {id, 1, topic, "cdr", pairs};
        mcap_put_channel(writer, &channel);
    }
    for (unsigned number = 0; number < MESSAGES; number++) {
        unsigned char data[90];
        memset(data, (int)number, sizeof(data));
        const struct mcap_message message = {
            (uint16_t)(1 + number % CHANNELS), number, time_of(number), number, data, size_of(number)};
        mcap_put_message(writer, &message);
        if (number % CHUNK == CHUNK - 1)
            CHECK_EQUAL(mcap_flush(writer), 0);
    }
    CHECK_EQUAL(mcap_finish(writer), 0);
    CHECK_EQUAL(mcap_written(writer), lseek(fd, 0, SEEK_END));
    mcap_writer_free(writer);
    return fd;
}

/* Reads all messages and compares each with the written one; returns their number. */
static unsigned read_all(struct mcap_reader *reader) {
    struct mcap_message message;
    unsigned count = 0;
    uint64_t before = 0;
    int result;
    while ((result = mcap_next(reader, &message)) > 0) {
        CHECK(message.sequence < MESSAGES && message.log_time >= before);
        CHECK_EQUAL(message.log_time, time_of(message.sequence));
        CHECK_EQUAL(message.publish_time, message.sequence);
        CHECK_EQUAL(message.channel, 1 + message.sequence % CHANNELS);
        CHECK_EQUAL(message.size, size_of(message.sequence));
        for (size_t i = 0; i < message.size; i++)
            CHECK(message.data[i] == (unsigned char)message.sequence);
        before = message.log_time;
        count++;
    }
    CHECK(result == 0);
    return count;
}

static void test_whole(void) {
    char error[MCAP_ERROR_MAX];
    int fd = write_file();
    struct mcap_reader *reader = mcap_open(path, error);
    uint64_t first, last;
    CHECK(reader);
    CHECK(mcap_state(reader).complete && mcap_state(reader).chunks == MESSAGES / CHUNK);
    CHECK(!strcmp(mcap_metadata(reader, "times", "key"), "value") && !mcap_metadata(reader, "times", "no"));
    CHECK(!strcmp(mcap_channel(reader, 2)->topic, "t2") && !mcap_channel(reader, 4));
    CHECK(!strcmp(mcap_value(mcap_channel(reader, 2), "key"), "value"));
    CHECK(!strcmp(mcap_schema(reader, 1)->encoding, "ros2msg"));
    mcap_times(reader, &first, &last);
    CHECK_EQUAL(first, time_of(0));
    CHECK_EQUAL(last, time_of(MESSAGES - 1));
    for (int pass = 0; pass < 2; pass++, mcap_rewind(reader))
        CHECK_EQUAL(read_all(reader), MESSAGES);
    const struct mcap_message *messages;
    CHECK_EQUAL(mcap_chunk(reader, 1, &messages), CHUNK);
    CHECK_EQUAL(messages[0].sequence, CHUNK); /* as in the file */
    CHECK_EQUAL(mcap_chunk(reader, MESSAGES / CHUNK, &messages), -ENOENT);
    mcap_close(reader);
    close(fd);
}

#define LARGE ((size_t)33 << 20) /* two of these exceed the limit of unpacked memory */

/* Large chunks that all overlap in time: not all of them are unpacked at once, and the order is the same. */
static void test_overlap(void) {
    int fd = memfd_create("overlap", MFD_CLOEXEC);
    char error[MCAP_ERROR_MAX], name[64];
    struct mcap_writer *writer = mcap_writer_new(fd);
    const struct mcap_channel channel = {1, 0, "t", "cdr", NULL};
    unsigned char *large = calloc(1, LARGE);
    CHECK(fd >= 0 && writer && large);
    mcap_put_channel(writer, &channel);
    for (uint32_t chunk = 0; chunk < 2; chunk++) {
        for (uint32_t part = 0; part < 2; part++) {
            const uint32_t number = part * 2 + chunk;
            const struct mcap_message message = {1, number, number, chunk, large, part ? LARGE : 9};
            mcap_put_message(writer, &message);
        }
        CHECK_EQUAL(mcap_flush(writer), 0);
    }
    CHECK_EQUAL(mcap_finish(writer), 0);
    mcap_writer_free(writer);
    free(large);
    snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
    struct mcap_reader *reader = mcap_open(name, error);
    CHECK(reader);
    struct mcap_message message;
    for (uint32_t number = 0; number < 4; number++) {
        CHECK_EQUAL(mcap_next(reader, &message), 1);
        CHECK_EQUAL(message.sequence, number);
        CHECK_EQUAL(message.publish_time, number % 2);
        CHECK_EQUAL(message.data[message.size - 1], 0);
    }
    CHECK_EQUAL(mcap_next(reader, &message), 0);
    mcap_rewind(reader);
    CHECK_EQUAL(mcap_next(reader, &message), 1);
    CHECK_EQUAL(message.sequence, 0);
    CHECK(!mcap_state(reader).damaged && !mcap_state(reader).refused);
    mcap_close(reader);
    close(fd);
}

/* Cut at each byte: messages in whole chunks are read, and never fewer with more bytes. */
static void test_cut(void) {
    char error[MCAP_ERROR_MAX];
    int fd = write_file();
    off_t size = lseek(fd, 0, SEEK_END);
    unsigned most = MESSAGES;
    for (off_t cut = size - 1; cut >= 0; cut--) {
        CHECK_EQUAL(ftruncate(fd, cut), 0);
        struct mcap_reader *reader = mcap_open(path, error);
        CHECK(reader || (cut < 8 && *error));
        if (!reader)
            continue;
        CHECK(!mcap_state(reader).complete && !mcap_state(reader).damaged);
        unsigned count = read_all(reader);
        CHECK(count <= most && count % CHUNK == 0);
        most = count;
        mcap_close(reader);
    }
    CHECK_EQUAL(most, 0);
    close(fd);
}

/* One byte wrong, anywhere. */
static void test_damaged(void) {
    char error[MCAP_ERROR_MAX];
    int fd = write_file();
    off_t size = lseek(fd, 0, SEEK_END);
    unsigned noticed = 0;
    for (off_t at = 0; at < size; at++) {
        unsigned char byte, wrong;
        CHECK_EQUAL(pread(fd, &byte, 1, at), 1);
        wrong = byte ^ (unsigned char)(1 << at % 8);
        CHECK_EQUAL(pwrite(fd, &wrong, 1, at), 1);
        struct mcap_reader *reader = mcap_open(path, error);
        if (reader) {
            struct mcap_message message;
            unsigned count = 0;
            while (mcap_next(reader, &message) > 0) {
                CHECK(message.sequence < MESSAGES && message.size == size_of(message.sequence));
                for (size_t i = 0; i < message.size; i++)
                    CHECK(message.data[i] == (unsigned char)message.sequence);
                count++;
            }
            CHECK(count == MESSAGES || mcap_state(reader).damaged || !mcap_state(reader).complete);
            noticed += count < MESSAGES;
        }
        mcap_close(reader);
        CHECK_EQUAL(pwrite(fd, &byte, 1, at), 1);
    }
    CHECK(noticed > 500); /* the chunks */
    close(fd);
}

/* The disk is full: flushed messages stay, and no more are added. */
static void test_failed_write(void) {
    int fd = open("/dev/full", O_WRONLY | O_CLOEXEC);
    struct mcap_writer *writer = mcap_writer_new(fd);
    CHECK_EQUAL(mcap_flush(writer), -ENOSPC);
    CHECK_EQUAL(mcap_flush(writer), -ENOSPC);
    CHECK_EQUAL(mcap_finish(writer), -ENOSPC);
    CHECK_EQUAL(mcap_written(writer), 0);
    mcap_writer_free(writer);
    close(fd);
}

static void test_checksum(void) {
    CHECK_EQUAL(crc32_of(0, "123456789", 9), 0xcbf43926); /* the check value of this CRC */
    CHECK_EQUAL(crc32_of(crc32_of(0, "12345", 5), "6789", 4), 0xcbf43926);
}

int main(void) {
    test_checksum();
    test_whole();
    test_overlap();
    test_cut();
    test_damaged();
    test_failed_write();
    return 0;
}
