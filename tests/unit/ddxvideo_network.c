/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Addresses as text: IPv4 and IPv6, with and without port and interface; other texts are refused. */
#include "network.h"

#include <arpa/inet.h>
#include <errno.h>

#include "check.h"

/* Reads the text and writes it again, with its port or 7. */
static void is_read(const char *text, const char *wanted, bool group, unsigned overhead) {
    struct network_address address;
    char written[NETWORK_TEXT_MAX];

    CHECK(network_parse(text, 7, &address));
    if (strcmp(network_text(&address, written), wanted)) {
        fprintf(stderr, "%s became %s, not %s\n", text, written, wanted);
        exit(1);
    }
    CHECK_EQUAL(network_is_group(&address), group);
    CHECK_EQUAL(network_overhead(&address), overhead);
    CHECK_EQUAL(network_size(&address), overhead == 28 ? sizeof(struct sockaddr_in) : sizeof(struct sockaddr_in6));
}

static void test_read(void) {
    is_read("10.0.0.2", "10.0.0.2:7", false, 28);
    is_read("10.0.0.2:65535", "10.0.0.2:65535", false, 28);
    is_read("239.255.20.5:8000", "239.255.20.5:8000", true, 28);
    is_read("::1", "[::1]:7", false, 48);
    is_read("[::1]", "[::1]:7", false, 48);
    is_read("[FD00:0::2]:8000", "[fd00::2]:8000", false, 48);
    is_read("ff15::5", "[ff15::5]:7", true, 48);
    is_read("[ff15::5]:8000", "[ff15::5]:8000", true, 48);
    is_read("ff02::5", "[ff02::5]:7", true, 48);
    is_read("fe80::1%eth0", "[fe80::1%eth0]:7", false, 48);
    is_read("[fe80::1%2]:8000", "[fe80::1%2]:8000", false, 48);
    is_read("[ff02::5%interface-of-15]:8000", "[ff02::5%interface-of-15]:8000", true, 48);
    is_read("1:2:3:4:5:6:7:8%eth0", "[1:2:3:4:5:6:7:8%eth0]:7", false, 48);
}

static void test_refused(void) {
    static const char *const wrong[] = {
        "",
        ":",
        ":8000",
        "10.0.0",
        "10.0.0.2:",
        "10.0.0.2:0",
        "10.0.0.2:65536",
        "10.0.0.2:100000",
        "10.0.0.2: 1",
        "10.0.0.2:+1",
        "10.0.0.2:1x",
        "10.0.0.2%eth0",
        "[10.0.0.2]",
        "[10.0.0.2]:1",
        "robot",
        "robot:1",
        "[",
        "[]",
        "[::1",
        "[::1]8000",
        "[::1]:",
        "[::1]:0",
        "[::1]:65536",
        "::1]",
        "[[::1]]",
        "::ffff:10.0.0.2",
        "fe80::1",
        "[fe80::1]:8000",
        "fe80::1%",
        "fe80::1%eth 0",
        "fe80::1%\x1b[2J",
        "[fe80::1%]:1",
        "fe80::1%interface-of-16b",
        "::1:",
        "1:2",
        "1:2:3:4:5:6:7:8:9",
        "%eth0",
        "[%eth0]:1",
        "ff15::5 ",
        "ff15::5/64",
        "1111:2222:3333:4444:5555:6666:7777:8888:9999:1111:2222:3333:4444:5555:6666:7777"};

    for (unsigned i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct network_address address;
        if (network_parse(wrong[i], 7, &address)) {
            fprintf(stderr, "'%s' is no address\n", wrong[i]);
            exit(1);
        }
    }
    struct network_address address;
    CHECK(!network_parse("10.0.0.2", 0, &address) && !network_parse("::1", 65536, &address));
}

static void test_interface(void) {
    struct network_address address;
    unsigned lo = if_nametoindex("lo");

    CHECK_EQUAL(network_interface("lo"), lo);
    CHECK_EQUAL(network_interface("no such one"), 0);
    CHECK_EQUAL(network_interface("99999999999"), 0);
    CHECK(network_parse("fe80::1%lo", 7, &address));
    CHECK_EQUAL(network_find_zone(&address), lo ? 0 : -ENODEV);
    CHECK_EQUAL(address.v6.sin6_scope_id, lo);
    CHECK(network_parse("fe80::1%none", 7, &address));
    CHECK_EQUAL(network_find_zone(&address), -ENODEV);
    CHECK(network_parse("10.0.0.2", 7, &address) && !network_find_zone(&address));
}

/* Addresses from recvfrom(), also of IPv4 through an IPv6 socket. */
static void test_from(void) {
    struct network_address address;
    struct sockaddr_storage storage = {0};
    char text[NETWORK_TEXT_MAX];
    struct sockaddr_in6 v6 = {.sin6_family = AF_INET6, .sin6_port = htons(9)};

    CHECK(!network_from(&address, &storage));
    inet_pton(AF_INET6, "::ffff:10.0.0.2", &v6.sin6_addr);
    memcpy(&storage, &v6, sizeof v6);
    CHECK(network_from(&address, &storage) && !strcmp(network_text(&address, text), "10.0.0.2:9"));
    inet_pton(AF_INET6, "fe80::2", &v6.sin6_addr);
    v6.sin6_scope_id = 3;
    memcpy(&storage, &v6, sizeof v6);
    CHECK(network_from(&address, &storage) && !strcmp(network_text(&address, text), "[fe80::2%3]:9"));
}

int main(void) {
    test_read();
    test_refused();
    test_interface();
    test_from();
    return 0;
}
