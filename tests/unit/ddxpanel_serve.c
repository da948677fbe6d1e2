/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The panel's process of root, by what it receives from the web process: any bytes, logins, orders. */
#include "serve.h"
#include "check.h"
#include "login.h"
#include "message.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define PASSPHRASE "open sesame, please"
#define FOREVER 60 /* s; longer than this test */

/* Orders whose programs each machine has: the table of the product is in order.c. */
static const struct order *find(const char *const *words, const char *command[ORDER_WORDS], const char **reason) {
    static const struct order orders[] = {
        {"say", {"/bin/echo"}, FOREVER, 1 << 20, ORDER_SHOWS},
        {"fill", {"/usr/bin/head", "-c", "100000", "/dev/zero"}, FOREVER, 1 << 20, ORDER_SHOWS},
        {"wait", {"/bin/sleep", "60"}, FOREVER, 1 << 20, ORDER_SHOWS},
        {"late", {"/bin/sleep", "60"}, 1, 1 << 20, ORDER_SHOWS},
        {"change", {"/bin/sh", "-c"}, FOREVER, 1 << 20, ORDER_CHANGES},
        {"bytes", {"/bin/sh", "-c"}, FOREVER, 1 << 20, ORDER_BYTES},
        {"nothing", {"/no/such/program"}, FOREVER, 1 << 20, ORDER_SHOWS},
    };

    for (size_t i = 0; i < sizeof orders / sizeof orders[0]; i++) {
        unsigned count = 0;

        if (strcmp(words[0], orders[i].form) != 0)
            continue;
        for (; orders[i].command[count]; count++)
            command[count] = orders[i].command[count];
        command[count] = words[1];
        command[count + !!words[1]] = NULL;
        return &orders[i];
    }
    *reason = "there is no such order";
    return NULL;
}

struct root {
    pid_t process;
    int web, log;
};

static struct serve serving; /* of the next one, besides what begin() sets */

static struct root begin(const char *passphrase, __typeof__(&find) table) {
    struct root root;
    int ends[2], log[2];

    CHECK(!socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) && !pipe2(log, O_CLOEXEC));
    root = (struct root){.process = fork(), .web = ends[0], .log = log[0]};
    CHECK(root.process >= 0);
    if (!root.process) {
        dup2(log[1], STDERR_FILENO);
        dup2(log[1], STDOUT_FILENO); /* what a failed check leaves behind does not keep the output of this test open */
        close(ends[0]);
        close(log[1]);
        serving.web = ends[1];
        serving.passphrase = passphrase;
        serving.find = table;
        _exit(-serve(&serving));
    }
    close(ends[1]);
    close(log[1]);
    return root;
}

/* The web process exits; the log of the other one, which exits with this status: 0 or an error. */
static const char *end_with(struct root *root, int expected) {
    static char text[4096];
    size_t size = 0;
    ssize_t got;
    int status;

    if (!expected)
        close(root->web);
    CHECK(waitpid(root->process, &status, 0) == root->process && WIFEXITED(status));
    CHECK_EQUAL(WEXITSTATUS(status), expected);
    while ((got = read(root->log, text + size, sizeof text - 1 - size)) > 0)
        size += (size_t)got;
    text[size] = 0;
    close(root->log);
    return text;
}

static const char *end(struct root *root) {
    return end_with(root, 0);
}

static struct message_answer sent(const struct root *root, const struct message_request *request, size_t size,
                                  int *fd) {
    struct message_answer answer;

    CHECK_EQUAL(send(root->web, request, size, 0), (ssize_t)size);
    CHECK_EQUAL(message_receive(root->web, &answer, fd), 0);
    CHECK((*fd >= 0) == (answer.status == 200 && request->kind == MESSAGE_ORDER));
    return answer;
}

/* `text` has `size` bytes, with the 0 bytes of its words. */
static struct message_answer ask(const struct root *root, enum message_kind kind, const char *address, const char *text,
                                 size_t size, int *fd) {
    struct message_request request = {.kind = kind, .session = 7, .size = (uint32_t)size};

    strcpy(request.address, address);
    memcpy(request.text, text, size);
    return sent(root, &request, offsetof(struct message_request, text) + size, fd);
}

static struct message_answer log_in(const struct root *root, const char *address, const char *passphrase) {
    int none;

    return ask(root, MESSAGE_LOGIN, address, passphrase, strlen(passphrase) + 1, &none);
}

#define ORDER(root, words, fd) ask(root, MESSAGE_ORDER, "10.0.0.1", words, sizeof(words), fd)

/* All output of an order into `text`; how it ended. */
static struct message_end output(int fd, char *text, size_t room, size_t *size) {
    char packet[1 + MESSAGE_PIECE];
    struct message_end end;
    ssize_t got;

    for (*size = 0; (got = recv(fd, packet, sizeof packet, 0)) > 0 && *packet == 'o'; *size += (size_t)got - 1) {
        CHECK(*size + (size_t)got - 1 <= room);
        memcpy(text + *size, packet + 1, (size_t)got - 1);
    }
    CHECK_EQUAL(got, sizeof end);
    memcpy(&end, packet, sizeof end);
    CHECK(end.mark == 'e');
    CHECK_EQUAL(recv(fd, packet, sizeof packet, 0), 0);
    close(fd);
    return end;
}

static int64_t now_ms(void) {
    struct timespec now;

    clock_gettime(CLOCK_BOOTTIME, &now);
    return (int64_t)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

static void test_login(void) {
    struct root root = begin(PASSPHRASE, find);
    struct message_answer answer;
    int64_t begun;

    CHECK_EQUAL(log_in(&root, "10.0.0.1", PASSPHRASE).status, 200);
    do { /* again if this process had to wait for longer than the block */
        begun = now_ms();
        CHECK_EQUAL(log_in(&root, "10.0.0.1", "guess").status, 401);
        answer = log_in(&root, "::ffff:10.0.0.1", PASSPHRASE); /* the same visitor */
        CHECK(answer.status == 429 || now_ms() - begun >= 1000);
    } while (answer.status != 429);
    CHECK(answer.wait && answer.wait <= 1000);
    CHECK_EQUAL(log_in(&root, "10.0.0.2", PASSPHRASE).status, 200);
    CHECK_EQUAL(log_in(&root, "10.0.0.3", "").status, 401);
    CHECK_EQUAL(log_in(&root, "nowhere", PASSPHRASE).status, 400);
    const char *log = end(&root);
    CHECK(strstr(log, "10.0.0.1: logged in\n") == log && strstr(log, "\n10.0.0.1: wrong passphrase\n"));
    CHECK(strstr(log, "\n10.0.0.2: logged in\n10.0.0.3: wrong passphrase\n") && !strstr(log, "sesame"));
    root = begin(NULL, find);
    CHECK_EQUAL(log_in(&root, "10.0.0.1", "").status, 401);
    end(&root);
}

static void test_orders(void) {
    struct root root = begin(PASSPHRASE, find);
    static char text[200000];
    size_t size;
    int fd;

    CHECK_EQUAL(ORDER(&root, "say\0;reboot $HOME", &fd).status, 200);
    struct message_end how = output(fd, text, sizeof text, &size);
    CHECK(!how.end && !how.status && size == 14 && !memcmp(text, ";reboot $HOME\n", 14));
    CHECK_EQUAL(ORDER(&root, "fill", &fd).status, 200);
    how = output(fd, text, sizeof text, &size);
    CHECK(!how.end && !how.status && size == 100000);
    CHECK_EQUAL(ORDER(&root, "late", &fd).status, 200);
    how = output(fd, text, sizeof text, &size);
    CHECK(how.end == 2 && how.status == SIGKILL);
    CHECK_EQUAL(ORDER(&root, "nothing", &fd).status, 200);
    how = output(fd, text, sizeof text, &size);
    CHECK(how.end == MESSAGE_NOT_STARTED && how.status == ENOENT);
    struct message_answer answer = ORDER(&root, "sh\0-c\0reboot", &fd);
    CHECK(answer.status == 400 && !strcmp(answer.reason, "there is no such order"));
    CHECK(!strcmp(end(&root), "10.0.0.1, session 7: say ;reboot $HOME: exit status 0\n"
                              "10.0.0.1, session 7: fill: exit status 0\n"
                              "10.0.0.1, session 7: late: took too long, killed by signal 9\n"
                              "10.0.0.1, session 7: nothing: not started, error 2\n"
                              "10.0.0.1, session 7: refused: there is no such order\n"));
}

/* The socket of one more order, which starts when a former one has ended: within 4 s even on a busy machine. */
static int begin_to_wait(const struct root *root) {
    int fd = -1;

    for (int tries = 0; tries < 400 && ORDER(root, "wait", &fd).status != 200; tries++)
        usleep(10000);
    CHECK(fd >= 0);
    return fd;
}

static void test_orders_do_not_wait_for_each_other(void) {
    struct root root = begin(PASSPHRASE, find);
    char text[64];
    size_t size;
    int fd[SERVE_ORDERS], more;

    for (int i = 0; i < SERVE_ORDERS - 1; i++)
        CHECK_EQUAL(ORDER(&root, "wait", &fd[i]).status, 200);
    CHECK_EQUAL(ORDER(&root, "say\0hello", &more).status, 200);
    output(more, text, sizeof text, &size);
    CHECK(size == 6);
    fd[SERVE_ORDERS - 1] = begin_to_wait(&root);
    CHECK_EQUAL(ORDER(&root, "wait", &more).status, 409);
    CHECK_EQUAL(log_in(&root, "10.0.0.1", PASSPHRASE).status, 200);
    close(fd[0]); /* its visitor stops it */
    fd[0] = begin_to_wait(&root);
    for (int i = 0; i < SERVE_ORDERS; i++)
        close(fd[i]);
    const char *log = end(&root); /* which is complete when the last program was killed */
    for (int i = 0; i < SERVE_ORDERS + 1; i++) {
        log = strstr(log, "wait: was not wanted any more, killed by signal 9\n");
        CHECK(log++);
    }
}

/* Half a change would be worse than a whole one, and a visitor's phone can lose its network at any time. */
static void test_a_change_goes_on_without_its_visitor(void) {
    struct root root = begin(PASSPHRASE, find);
    int fd;

    CHECK_EQUAL(ORDER(&root, "change\0for i in 1 2 3; do sleep 0.1; echo on; done", &fd).status, 200);
    close(fd);
    CHECK(strstr(end(&root), "done: exit status 0\n"));
}

/* A program's message must not be in the middle of a recording. */
static void test_bytes_are_those_of_standard_output(void) {
    struct root root = begin(PASSPHRASE, find);
    char text[64];
    size_t size;
    int fd;

    CHECK_EQUAL(ORDER(&root, "bytes\0echo wrong >&2; echo good", &fd).status, 200);
    struct message_end how = output(fd, text, sizeof text, &size);
    CHECK(!how.end && !how.status && size == 5 && !memcmp(text, "good\n", 5));
    CHECK(strstr(end(&root), "wrong\n") != NULL);
}

/* They run for long, and other orders find a place. */
static void test_two_files_at_a_time(void) {
    struct root root = begin(PASSPHRASE, find);
    int fd[SERVE_BYTES], more;

    for (int i = 0; i < SERVE_BYTES; i++)
        CHECK_EQUAL(ORDER(&root, "bytes\0sleep 60", &fd[i]).status, 200);
    struct message_answer answer = ORDER(&root, "bytes\0sleep 60", &more);
    CHECK(answer.status == 409 && !strcmp(answer.reason, "two files are being fetched already"));
    CHECK_EQUAL(ORDER(&root, "wait", &more).status, 200);
    close(more);
    for (int i = 0; i < SERVE_BYTES; i++)
        close(fd[i]); /* the visitor has gone */
    const char *log = end(&root);
    for (int i = 0; i < SERVE_BYTES; i++) {
        log = strstr(log, "sleep 60: was not wanted any more, killed by signal 9\n");
        CHECK(log++);
    }
}

static void test_a_link(void) {
    char folder[] = "/tmp/ddx-serve-XXXXXX", path[64];
    struct link link;

    CHECK(mkdtemp(folder) && !link_make(&link, now_ms() / 1000));
    snprintf(path, sizeof path, "%s/link", folder);
    CHECK(!link_leave(&link, path));
    serving.link = path;
    struct root root = begin(NULL, find);
    CHECK_EQUAL(log_in(&root, "10.0.0.1", link.text).status, 200);
    CHECK_EQUAL(log_in(&root, "10.0.0.2", link.text).status, 401); /* it works once */
    CHECK(!strcmp(end(&root), "10.0.0.1: logged in by a link\n10.0.0.2: wrong passphrase\n"));
    serving.link = NULL;
    CHECK(!rmdir(folder));
}

static void test_a_web_process_that_hangs(void) {
    struct message_request life = {.kind = MESSAGE_ALIVE, .size = 1, .address = "-"};
    size_t size = offsetof(struct message_request, text) + 1;
    struct message_answer answer;

    serving.silence = 1;
    struct root root = begin(NULL, find);
    int64_t begun = now_ms();
    for (int i = 0; i < 4; i++) { /* of a web process that lives for longer than that */
        if (send(root.web, &life, size, MSG_NOSIGNAL) < 0)
            CHECK(now_ms() - begun > 1000 * (i + 1)); /* this test was stopped for longer, on a busy machine */
        usleep(400000);
    }
    CHECK(recv(root.web, &answer, sizeof answer, MSG_DONTWAIT) <= 0); /* a sign of life has no answer */
    end_with(&root, ETIMEDOUT);
    CHECK(now_ms() - begun > 1000 + 3 * 400);
    close(root.web);
    serving.silence = 0;
}

static void test_a_part_that_exits(void) {
    int part[2];

    CHECK(!pipe2(part, O_CLOEXEC));
    serving.part[1] = part[0]; /* readable when it has exited, as the descriptor of a process */
    struct root root = begin(PASSPHRASE, find);
    CHECK_EQUAL(log_in(&root, "10.0.0.1", PASSPHRASE).status, 200);
    CHECK(write(part[1], "", 1) == 1);
    close(root.web);
    end_with(&root, ECHILD);
    close(part[0]);
    close(part[1]);
    serving.part[1] = 0;
}

/* The web process reads what the network sends: whatever it comes to send must do no harm. */
static void test_what_is_not_a_request(void) {
    struct root root = begin(PASSPHRASE, order_find);
    struct message_request request = {.kind = MESSAGE_ORDER, .size = 7, .address = "10.0.0.1", .text = "health"};
    size_t whole = offsetof(struct message_request, text);
    int fd;

    for (size_t size = 1; size < whole + 7; size++)
        CHECK_EQUAL(sent(&root, &request, size, &fd).status, 400);
    CHECK_EQUAL(sent(&root, &request, whole + 8, &fd).status, 400);
    request.size = 6; /* without its 0 byte */
    CHECK_EQUAL(sent(&root, &request, whole + 6, &fd).status, 400);
    request.size = UINT32_MAX;
    CHECK_EQUAL(sent(&root, &request, sizeof request, &fd).status, 400);
    request.kind = 3;
    request.size = 7;
    CHECK_EQUAL(sent(&root, &request, whole + 7, &fd).status, 400);
    request.kind = MESSAGE_ORDER;
    memset(request.address, '1', sizeof request.address);
    CHECK_EQUAL(sent(&root, &request, whole + 7, &fd).status, 400);
    strcpy(request.address, "10.0.0.1");
    request.size = MESSAGE_WORDS + 1; /* too many words, all empty */
    memset(request.text, 0, sizeof request.text);
    CHECK_EQUAL(sent(&root, &request, whole + request.size, &fd).status, 400);
    CHECK_EQUAL(ORDER(&root, "restart\0;reboot", &fd).status, 400);
    CHECK_EQUAL(ORDER(&root, "\x1b[2J\n", &fd).status, 400);
    CHECK_EQUAL(log_in(&root, "10.0.0.1", PASSPHRASE "\0x").status, 200);
    CHECK_EQUAL(ask(&root, MESSAGE_LOGIN, "10.0.0.1", PASSPHRASE "\0x", sizeof PASSPHRASE + 2, &fd).status, 400);
    end(&root);
}

int main(void) {
    test_login();
    test_what_is_not_a_request();
    test_orders();
    test_orders_do_not_wait_for_each_other();
    test_a_change_goes_on_without_its_visitor();
    test_bytes_are_those_of_standard_output();
    test_two_files_at_a_time();
    test_a_link();
    test_a_web_process_that_hangs();
    test_a_part_that_exits();
    return 0;
}
