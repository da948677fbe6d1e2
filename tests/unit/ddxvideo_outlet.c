/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The number of a report's sender: the same for all ports of a host. */
#include "outlet.h"

#include <arpa/inet.h>
#include <poll.h>
#include <string.h>
#include <unistd.h>

#include "check.h"

/* The number of a datagram from this address and any port. */
static uint64_t number_from(struct outlet *outlet, const struct sockaddr_in *to, const char *host) {
    struct sockaddr_in from = {.sin_family = AF_INET};
    uint64_t number = 0;
    char data[16];
    int fd = socket(AF_INET, SOCK_DGRAM, 0);

    CHECK(fd >= 0 && inet_pton(AF_INET, host, &from.sin_addr) == 1);
    CHECK(!bind(fd, (struct sockaddr *)&from, sizeof from));
    CHECK(sendto(fd, "report", 6, 0, (const struct sockaddr *)to, sizeof *to) == 6);
    CHECK(poll(&(struct pollfd){.fd = outlet->fd[OUTLET_IPV4], .events = POLLIN}, 1, 10000) == 1);
    CHECK(outlet_read(outlet, data, sizeof data, &number) == 6);
    close(fd);
    return number;
}

int main(void) {
    struct outlet outlet = {.fd = {-1, -1}, .to = "127.0.0.1", .port = 8000};
    struct sockaddr_in own;
    socklen_t size = sizeof own;
    char text[NETWORK_ERROR_MAX];

    CHECK(!outlet_parse(&outlet, text) && !outlet_open(&outlet, text));
    CHECK(!getsockname(outlet.fd[OUTLET_IPV4], (struct sockaddr *)&own, &size));
    inet_pton(AF_INET, "127.0.0.1", &own.sin_addr);
    uint64_t number = number_from(&outlet, &own, "127.0.0.3");
    CHECK(number_from(&outlet, &own, "127.0.0.3") == number); /* from another port */
    CHECK(number_from(&outlet, &own, "127.0.0.2") != number);
    outlet_close(&outlet);
    return 0;
}
