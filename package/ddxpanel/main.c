/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The panel: a web page of this machine. This process belongs to root: it opens ports, starts the others, and executes
 * orders. It reads no network socket.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <netinet/in.h>
#include <program.h>
#include <pwd.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/un.h>
#include <unistd.h>

#include "announce.h"
#include "clock.h"
#include "login.h"
#include "order.h"
#include "part.h"
#include "run.h"
#include "serve.h"
#include "web.h"

#define WAITING 64 /* connections that are not accepted yet */

static int listens(int fd, const void *address, socklen_t size) {
    const int yes = 1;

    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (!bind(fd, address, size) && !listen(fd, WAITING))
        return fd;
    int error = -errno;
    close(fd);
    return error;
}

/* Listen on all addresses of the machine, IPv6 and IPv4 with one socket where there is IPv6. The socket, or -errno. */
static int listen_tcp(uint16_t port) {
    const struct sockaddr_in6 six = {.sin6_family = AF_INET6, .sin6_port = htons(port)};
    const struct sockaddr_in four = {.sin_family = AF_INET, .sin_port = htons(port)};
    const int no = 0;
    int fd = socket(AF_INET6, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    if (fd >= 0) {
        setsockopt(fd, IPPROTO_IPV6, IPV6_V6ONLY, &no, sizeof no);
        return listens(fd, &six, sizeof six);
    }
    fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    return fd < 0 ? -errno : listens(fd, &four, sizeof four);
}

/* Listen at a path, for one user only. The socket, or -errno. */
static int listen_unix(const char *path, uid_t user) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};

    if (snprintf(address.sun_path, sizeof address.sun_path, "%s", path) >= (int)sizeof address.sun_path)
        return -ENAMETOOLONG;
    unlink(path);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return -errno;
    mode_t before = umask(0177);
    fd = listens(fd, &address, sizeof address);
    umask(before);
    if (fd < 0 || !lchown(path, user, (gid_t)-1))
        return fd;
    int error = -errno;
    close(fd);
    return error;
}

#define PLACE "/run/panel"
#define LINK PLACE "/link"
#define SCGI PLACE "/scgi"
#define KEY PLACE "/web.pem"     /* the web server's copy */
#define SUM PLACE "/certificate" /* its SHA-256, for `ddxctl panel` */
#define LIGHTTPD "/usr/sbin/lighttpd"
#define CONFIG "/usr/share/ddx/panel.conf"
#define MAKER "/usr/libexec/ddx/panel-certificate"
#define PROVISION "/run/provision"
#define MDNSD "/usr/sbin/mdnsd"
#define ANNOUNCED "/usr/share/ddx/panel.service"
#define SHOW "/usr/libexec/ddx/panel-console"
#define WEB_USER "ddxweb"
#define MDNS_USER "ddxmdns"
#define OWN_USER "ddxpanel"
#define NOGROUP 65534
#define LEAST 12   /* characters of a passphrase */
#define SILENCE 10 /* s */

/* All users may read these two. Only the web process has a use for the store. */
static const char *const network_hidden[] = {"/rec", "/data", "/run/ddx", NULL};
static const char *const web_process_hidden[] = {"/rec", "/data", NULL};

_Noreturn static void fail(const char *what, int error) {
    say("%s: %s", what, strerror(-error));
    exit(EXIT_FAILED);
}

/* The line panel= of ddx.txt, which provision.awk has checked, without these letters; empty if there is none. */
static const char *read_passphrase(void) {
    static const char key[] = "panel=";
    static char line[512];
    FILE *file = fopen(PROVISION, "re");
    bool found = false;

    while (file && !found && fgets(line, sizeof line, file)) {
        line[strcspn(line, "\n")] = 0;
        found = !strncmp(line, key, strlen(key)) && strlen(line) >= strlen(key) + LEAST;
    }
    if (!found)
        explicit_bzero(line, sizeof line);
    if (file)
        fclose(file);
    return found ? line + strlen(key) : "";
}

/* ---- Certificate ---- */

struct said {
    char text[256];
    size_t size;
};

static bool hear(void *to, const char *bytes, size_t size) {
    struct said *said = to;

    for (size_t i = 0; i < size && said->size < sizeof said->text - 1; i++)
        said->text[said->size++] = bytes[i];
    return true;
}

/* Have key and certificate in the folder; 0 or -errno. `said` is then the certificate's SHA-256, else a reason. */
static int have_certificate(const char *folder, struct said *said) {
    const struct run_for limits = {.seconds = 60, .output = sizeof said->text, .receiver = -1, hear, said};
    char name[HOST_NAME_MAX + 1] = "";
    const char *const command[] = {MAKER, folder, name, NULL};
    struct run run;

    gethostname(name, sizeof name - 1);
    *said = (struct said){.size = 0};
    int error = run_program(command, &limits, &run);
    said->text[strcspn(said->text, "\n")] = 0;
    if (!error && (run.end != RUN_EXITED || run.status))
        error = -EIO;
    return error;
}

/* Write a file of this process's own folder, for a user. */
static int leave(const char *path, const char *text, size_t size, uid_t user, mode_t mode) {
    unlink(path);
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);

    if (fd < 0)
        return -errno;
    int error = write(fd, text, size) != (ssize_t)size || fchmod(fd, mode) || fchown(fd, user, (gid_t)-1) ? -EIO : 0;
    close(fd);
    return error;
}

/* The web server's copy of key and certificate. */
static int copy_key(const char *folder, uid_t user) {
    char path[PATH_MAX], text[4096];

    snprintf(path, sizeof path, "%s/panel.pem", folder);
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0)
        return -errno;
    ssize_t size = read(fd, text, sizeof text);
    close(fd);
    int error = size <= 0 ? -EIO : leave(KEY, text, (size_t)size, user, 0400);
    explicit_bzero(text, sizeof text);
    return error;
}

static bool is_mounted(const char *folder) {
    struct stat here, root;

    return !stat(folder, &here) && !stat("/", &root) && here.st_dev != root.st_dev;
}

/* Kept on /data; where that is missing, full or broken, there is a temporary certificate, and browsers warn. */
static void prepare_certificate(uid_t user) {
    const char *folder = is_mounted("/data") ? "/data/panel" : PLACE "/own";
    struct said said;
    int error = have_certificate(folder, &said);

    if (error && strcmp(folder, PLACE "/own") != 0) {
        say("%s; the certificate is a temporary one", *said.text ? said.text : strerror(-error));
        folder = PLACE "/own";
        error = have_certificate(folder, &said);
    }
    if (!error)
        error = copy_key(folder, user);
    if (!error) {
        strcat(said.text, "\n"); /* shorter than its room: it was cut at a line feed */
        error = leave(SUM, said.text, strlen(said.text), 0, 0644);
    }
    if (error)
        fail(*said.text ? said.text : MAKER, error);
}

/* ---- Parts ---- */

struct ports {
    int https, http;
};

/* lighttpd takes the sockets from 3 on if the environment says so. */
static int run_web_server(void *argument) {
    const struct ports *ports = argument;
    static char path[] = "PATH=/usr/sbin:/usr/bin:/sbin:/bin", count[] = "LISTEN_FDS=2";
    char pid[32];
    char *const environment[] = {path, count, pid, NULL};
    char *const command[] = {LIGHTTPD, "-D", "-f", CONFIG, NULL};

    snprintf(pid, sizeof pid, "LISTEN_PID=%d", getpid());
    int https = fcntl(ports->https, F_DUPFD, 16), http = fcntl(ports->http, F_DUPFD, 16); /* not one of those below */
    if (https < 0 || http < 0 || dup2(https, 3) < 0 || dup2(http, 4) < 0 || close_range(5, ~0u, 0))
        return -errno;
    execve(LIGHTTPD, command, environment);
    return -errno;
}

struct ends {
    int listener, root;
};

static int run_web_process(void *argument) {
    struct ends *ends = argument;

    /* Close root's other descriptors: the ports, and its end of the socket pair. */
    int listener = fcntl(ends->listener, F_DUPFD, 16), root = fcntl(ends->root, F_DUPFD, 16);
    if (listener < 0 || root < 0 || dup2(listener, 3) < 0 || dup2(root, 4) < 0 || close_range(5, ~0u, 0))
        return -errno;
    return web_serve(3, 4);
}

/* mdnsd needs no privilege, since its port is above 1023. Its memory is limited, since other machines fill it. */
static int run_mdnsd(void *argument) {
    const struct rlimit memory = {8u << 20, 8u << 20};
    char *const command[] = {MDNSD, "-n", "-l", "err", ANNOUNCED, NULL};

    (void)argument;
    if (setrlimit(RLIMIT_DATA, &memory) || close_range(3, ~0u, 0))
        return -errno;
    execv(MDNSD, command);
    return -errno;
}

static int start(const struct part *part) {
    int fd = part_start(part);

    if (fd < 0)
        fail(part->name, fd);
    return fd;
}

/* The web server of a former run, which was killed with it, may still have the port for a moment. */
static int open_port(uint16_t port) {
    int fd = listen_tcp(port);
    char name[32];

    for (int tries = 0; fd == -EADDRINUSE && tries < 100; tries++) {
        usleep(50000);
        fd = listen_tcp(port);
    }
    snprintf(name, sizeof name, "port %u", port);
    if (fd < 0)
        fail(name, fd);
    return fd;
}

/* ---- Commands ---- */

/* `ddxctl panel login`: prints what follows the # of a link. */
static int log_in(void) {
    struct link link;
    int error = link_make(&link, clock_ms() / 1000);

    if (!error)
        error = link_leave(&link, LINK);
    if (error)
        fail(LINK, error);
    puts(link.text);
    explicit_bzero(&link, sizeof link);
    return EXIT_OK;
}

static int run(void) {
    const struct passwd *web = getpwnam(WEB_USER);
    int pair[2];

    if (!web)
        fail(WEB_USER, -ENOENT);
    uid_t user = web->pw_uid;
    umask(077);
    if ((mkdir(PLACE, 0711) && errno != EEXIST) || chmod(PLACE, 0711))
        fail(PLACE, -errno);
    unlink(LINK); /* of a former run */
    struct ports ports = {.https = open_port(443), .http = open_port(80)};
    prepare_certificate(user);
    int scgi = listen_unix(SCGI, user);
    if (scgi < 0)
        fail(SCGI, scgi);
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair))
        fail("sockets", -errno);
    /* Its processes hold no passphrase: it is read after they were started. */
    struct ends ends = {.listener = scgi, .root = pair[1]};
    struct serve serving = {.web = pair[0], .link = LINK, .silence = SILENCE, .find = order_find};
    serving.part[0] = start(&(struct part){"web process", OWN_USER, -1, web_process_hidden, run_web_process, &ends});
    serving.part[1] = start(&(struct part){"web server", WEB_USER, NOGROUP, network_hidden, run_web_server, &ports});
    close(pair[1]);
    close(scgi);
    close(ports.https);
    close(ports.http);
    const struct part mdnsd = {"mdnsd", MDNS_USER, NOGROUP, network_hidden, run_mdnsd, NULL};
    struct announce announce;
    serving.also = announce_open(&announce, &mdnsd, SHOW);
    if (serving.also < 0)
        fail("addresses", serving.also);
    serving.look = announce_look;
    serving.argument = &announce;
    const char *passphrase = read_passphrase();
    serving.passphrase = *passphrase ? passphrase : NULL;
    say("ready; %s", *passphrase ? "the passphrase of ddx.txt opens it" : "a link of `ddxctl panel login` opens it");
    int error = serve(&serving);
    say("stops: %s", !error || error == -ECHILD ? "one of its processes has exited"
                     : error == -ETIMEDOUT      ? "its web process hangs"
                                                : strerror(-error));
    return EXIT_FAILED;
}

int main(int argc, char **argv) {
    bool wants_link = false;
    const struct option_entry options[] = {
        {"login", NULL, "print the secret of a link, which logs in once within two minutes, and exit", OPTION_FLAG,
         &wants_link, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    struct program program = {.name = "ddxpanel",
                              .purpose = "The panel: a web page of this machine, at https://<its address>/.",
                              .options = options,
                              .brief = true};

    program_start(&program, argc, argv);
    if (program.check)
        return EXIT_OK;
    signal(SIGTERM, SIG_DFL); /* its other processes are killed with it */
    signal(SIGINT, SIG_DFL);
    return wants_link ? log_in() : run();
}
