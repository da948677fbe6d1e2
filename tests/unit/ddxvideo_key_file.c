/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The key file: both forms are read; files that another user can read, or without a key, are refused by name. */
#include "key_file.h"

#include <fcntl.h>
#include <stdbool.h>
#include <sys/stat.h>

#include "../scratch.h"
#include "check.h"

/* The key of RFC 3711, B.3. */
static const char base64[] = "4fl6DT4Bi+DWT6MsBt5BOQ7Gda1Jiv7rtpYLOqvm";
static const char hex[] = "e1f97a0d3e018be0d64fa32c06de41390ec675ad498afeebb6960b3aabe6";
static const uint8_t key[KEY_FILE_BYTES] = {0xe1, 0xf9, 0x7a, 0x0d, 0x3e, 0x01, 0x8b, 0xe0, 0xd6, 0x4f,
                                            0xa3, 0x2c, 0x06, 0xde, 0x41, 0x39, 0x0e, 0xc6, 0x75, 0xad,
                                            0x49, 0x8a, 0xfe, 0xeb, 0xb6, 0x96, 0x0b, 0x3a, 0xab, 0xe6};
static char *path;
static char error[KEY_FILE_ERROR_MAX];

static void write_file(const char *text, size_t length, mode_t mode) {
    unlink(path);
    int fd = open(path, O_WRONLY | O_CREAT, 0600);
    CHECK(fd >= 0 && write(fd, text, length) == (ssize_t)length && !fchmod(fd, mode));
    close(fd);
}

static bool accepted(const char *text, size_t length) {
    uint8_t read[KEY_FILE_BYTES];

    write_file(text, length, 0600);
    return key_file_read(path, read, error) && !memcmp(read, key, sizeof key);
}

/* Each complaint is one line, names the file and does not show its contents. */
static void check_refused(const char *words) {
    uint8_t read[KEY_FILE_BYTES];

    *error = 0;
    CHECK(!key_file_read(path, read, error));
    if (!strstr(error, words) || strncmp(error, path, strlen(path)) || strchr(error, '\n') || strstr(error, "4fl6")) {
        fprintf(stderr, "%s instead of: %s\n", error, words);
        exit(1);
    }
}

static void test_forms(void) {
    char text[100];
    size_t length = (size_t)sprintf(text, "%s\n", base64);

    CHECK(accepted(text, length) && accepted(text, length - 1));
    length = (size_t)sprintf(text, "%s \r\n", hex);
    CHECK(accepted(text, length) && accepted(text, length - 3));
    for (char *at = text; *at; at++)
        *at = (char)(*at >= 'a' ? *at - 32 : *at);
    CHECK(accepted(text, length));
    write_file(base64, 40, 0400);
    uint8_t read[KEY_FILE_BYTES];
    CHECK(key_file_read(path, read, error));
    key_file_text(key, text);
    CHECK(!strcmp(text, base64));
}

static void test_no_keys(void) {
    char text[200] = {0};

    for (size_t i = 0; i < 100; i++) /* of any other length */
        if (i != 40 && i != 60) {
            memset(text, 'a', sizeof text);
            write_file(text, i, 0600);
            check_refused("not a key");
        }
    sprintf(text, "%s\n%s\n", base64, base64);
    write_file(text, strlen(text), 0600);
    check_refused("not a key");
    for (int c = 0; c < 256; c++) { /* of any other digit */
        memcpy(text, hex, 60);
        text[30] = (char)c;
        if (strchr("0123456789abcdefABCDEF", c) && c)
            continue;
        write_file(text, 60, 0600);
        check_refused("not a key");
    }
    memcpy(text, base64, 40);
    text[39] = '=';
    write_file(text, 40, 0600);
    check_refused("not a key");
}

static void test_unsafe_files(void) {
    static const mode_t modes[] = {0644, 0640, 0604, 0660, 0620, 0700, 04600, 0000};
    for (size_t i = 0; i < sizeof modes / sizeof *modes; i++) {
        write_file(base64, 40, modes[i]);
        check_refused(modes[i] || geteuid() == 0 ? "must have mode 600" : "Permission denied");
    }
    unlink(path);
    check_refused("No such file");
    CHECK(!mkdir(path, 0600));
    check_refused("not a regular file");
    CHECK(!rmdir(path) && !mkfifo(path, 0600)); /* opening this one would block */
    check_refused("not a regular file");
    unlink(path);
    char *target = scratch_path("target");
    write_file(base64, 40, 0600);
    CHECK(!rename(path, target) && !symlink(target, path));
    check_refused("symbolic link");
    unlink(path);
    free(target);
}

/* Only root can make such a file, or become another user. */
static void test_owner(void) {
    if (geteuid() != 0)
        return;
    write_file(base64, 40, 0600);
    CHECK(!chown(path, 12345, 12345));
    check_refused("belongs to user 12345");
    CHECK(!chmod(scratch_folder, 0755) && !seteuid(12345));
    uint8_t read[KEY_FILE_BYTES];
    CHECK(key_file_read(path, read, error));
    CHECK(!seteuid(0));
}

int main(void) {
    scratch_make();
    path = scratch_path("stream.key");
    test_forms();
    test_no_keys();
    test_unsafe_files();
    test_owner();
    free(path);
    return 0;
}
