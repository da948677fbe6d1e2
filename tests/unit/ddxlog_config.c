/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The items that are logged, and how often. tests/host/test_log.py checks wrong files. */
#include "check.h"
#include "config.h"

#include <sys/mman.h>
#include <unistd.h>

static struct config read_config(const char *text) {
    struct config config;
    char path[64], error[CONFIG_ERROR_MAX];
    int fd = memfd_create("config", MFD_CLOEXEC);
    CHECK(fd >= 0 && write(fd, text, strlen(text)) == (ssize_t)strlen(text));
    snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
    CHECK_EQUAL(config_read(path, &config, error), 0);
    close(fd);
    return config;
}

static int64_t period(const struct config *config, const char *item, const char *type) {
    const struct config_rule *rule = config_rule_for(config, item, type);
    return rule ? rule->period : -1;
}

static void test_rules(void) {
    struct config config = read_config("except gps.raw\nitem gps* rate=4\nitem imu # all\nitem video\n\n"
                                       "item [a-c]? rate=0.5\n");
    CHECK_EQUAL(period(&config, "gps", "GPS"), 250000000);
    CHECK_EQUAL(period(&config, "gps.fix", "GPS"), 250000000);
    CHECK_EQUAL(period(&config, "gps.raw", "GPS"), -1);
    CHECK_EQUAL(period(&config, "imu", "IMU"), 0);
    CHECK_EQUAL(period(&config, "imu2", "IMU"), -1);
    CHECK_EQUAL(period(&config, "b1", "int"), 2000000000);
    CHECK_EQUAL(period(&config, "d1", "int"), -1);
    CHECK_EQUAL(period(&config, "video", "DDX_VIDEO"), 0);
    CHECK(!strcmp(config.folder, "."));
    config_free(&config);
    config = read_config("output /rec/log segment=1G minutes=2\nqueue 128K\nitem *");
    CHECK_EQUAL(period(&config, "video", "DDX_VIDEO"), -1); /* a pattern does not match pictures */
    CHECK_EQUAL(period(&config, "video.frame", "int"), 0);
    CHECK_EQUAL(config.segment, 1 << 30);
    CHECK_EQUAL(config.age, INT64_C(120000000000));
    CHECK_EQUAL(config.queue, 128 << 10);
    config_free(&config);
}

int main(void) {
    test_rules();
    return 0;
}
