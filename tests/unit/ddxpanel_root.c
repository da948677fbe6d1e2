/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The panel's root process: which orders it executes, how it runs them, and limits of guesses. */
#include "check.h"
#include "login.h"
#include "order.h"
#include "run.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define ORDER(...) find((const char *const[]){__VA_ARGS__, NULL})

static const char *command[ORDER_WORDS], *reason;

/* The command of an order as text, or "" if it is refused. */
static const char *find(const char *const *words) {
    static char text[256];
    const struct order *order = order_find(words, command, &reason);

    CHECK(!order == !!reason);
    CHECK(!order || (order->seconds && order->output));
    text[0] = 0;
    for (unsigned i = 0; order && command[i]; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%s%s", i ? " " : "", command[i]);
    return text;
}

static bool same(const char *one, const char *other) {
    return !strcmp(one, other);
}

static void test_orders(void) {
    CHECK(same(ORDER("health"), "/usr/bin/ddxctl health --json"));
    CHECK(same(ORDER("services"), "/usr/bin/ddxctl services --json"));
    CHECK(same(ORDER("items"), "/usr/bin/ddxctl list --json"));
    CHECK(same(ORDER("restart", "ddxvideosend.rear"), "/usr/bin/ddxctl restart ddxvideosend.rear"));
    CHECK(same(ORDER("machine", "off"), "/sbin/poweroff"));
    CHECK(same(ORDER("record", "split"), "/usr/bin/ddxctl record split"));
    CHECK(same(ORDER("recordings"), "/usr/bin/ddxctl recordings list --json"));
    CHECK(same(ORDER("recordings", "verify"), "/usr/libexec/ddx/panel-job begin verify"));
    CHECK(same(ORDER("recordings", "verify", "video-000012"), "/usr/libexec/ddx/panel-job begin verify video-000012"));
    CHECK(same(ORDER("recordings", "copy", "video-000012", "usb"),
               "/usr/libexec/ddx/panel-job begin export video-000012 usb"));
    CHECK(same(ORDER("recordings", "copy", "all", "usb"), "/usr/libexec/ddx/panel-job begin export all usb"));
    CHECK(same(ORDER("recordings", "remove", "video-000012"), "/usr/bin/ddxctl recordings remove video-000012"));
    CHECK(same(ORDER("recordings", "read", "video-000012.mp4", "4096"),
               "/usr/bin/ddxctl recordings read -size video-000012.mp4 4096"));
}

static void test_recordings_that_are_refused(void) {
    static const char *const names[] = {"",   "-folder", "--json", "../x",   "/rec/x", "a/b", ".",
                                        ".x", "a b",     "a;b",    "newest", "*",      "a\nb"};
    static const char *const numbers[] = {"", "-1", "+1", " 1", "1x", "0x1", "-size", "9999999999999999999"};

    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        CHECK(same(ORDER("recordings", "remove", names[i]), ""));
        CHECK(same(ORDER("recordings", "verify", names[i]), ""));
        CHECK(same(ORDER("recordings", "copy", names[i], "usb"), ""));
        CHECK(same(ORDER("recordings", "read", names[i], "0"), ""));
    }
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
        CHECK(same(ORDER("recordings", "read", "video.mp4", numbers[i]), "") && same(reason, "is not a number"));
    CHECK(same(ORDER("recordings", "copy", "video-000012", "/etc"), "") && same(reason, "is not usb"));
    CHECK(same(ORDER("recordings", "copy", "all", "/etc"), "") && same(ORDER("recordings", "copy", "all"), ""));
    CHECK(same(ORDER("recordings", "remove", "all"), "") && same(ORDER("recordings", "verify", "all"), ""));
    CHECK(same(ORDER("recordings", "read", "all", "0"), ""));
    CHECK(same(ORDER("recordings", "copy", "video-000012"), ""));
    CHECK(same(ORDER("recordings", "export", "video-000012", "usb"), ""));
    CHECK(same(ORDER("recordings", "remove"), "") && same(ORDER("recordings", "remove", "a", "b"), ""));
    CHECK(same(ORDER("record", "pre-roll"), "") && same(ORDER("record", "stop", "other"), ""));
}

static void test_streams(void) {
    static const char *const wrong[] = {"",       "to",         "to=",   "to=-x",      "=x",      "key=a",    "sdp=a",
                                        "user=a", "realtime=9", "-to=a", "to=a b",     "to=a/b",  "to=a;b",   "to=a\nb",
                                        "TO=a",   "too=a",      "t=a",   "name=$(id)", "needs=a", "mounted=a"};

    CHECK(same(ORDER("add", "ddxvideosend.a", "group=none", "to=[fd00::2]:8000,10.0.0.2", "port=8004", "name=rear:x",
                     "ts=8100", "wire=800"),
               "/usr/bin/ddxctl add ddxvideosend.a group=none to=[fd00::2]:8000,10.0.0.2 port=8004 name=rear:x ts=8100 "
               "wire=800"));
    CHECK(
        same(ORDER("add", "ddxvideosend.a", "port=1", "port=2", "port=3", "port=4", "port=5", "port=6", "port=7"), ""));
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++)
        if (!same(ORDER("add", "ddxvideosend.a", "port=1", wrong[i]), "") ||
            !same(reason, "is not a setting of a stream"))
            CHECK_EQUAL(i, 1000);
    CHECK(same(ORDER("add", "ddxvideosend", "port=1"), "") &&
          same(reason, "is not an added stream, ddxvideosend.NAME"));
    CHECK(same(ORDER("add", "ddxvideoload.a", "port=1"), "") && same(ORDER("add", "ddxvideosend.a"), ""));
    CHECK(same(ORDER("remove", "ddxvideosend.a"), "/usr/bin/ddxctl remove ddxvideosend.a"));
    CHECK(same(ORDER("remove", "ddxvideosend"), "") && same(ORDER("remove", "ddxlog.a"), ""));
    CHECK(same(ORDER("stream", "ddxvideosend.a"), "/usr/bin/ddxctl stream ddxvideosend.a"));
    CHECK(same(ORDER("reset", "settings"), "/usr/libexec/ddx/panel-reset"));
    CHECK(same(ORDER("reset", "settings", "recordings"), ""));
    CHECK(same(ORDER("job"), "/usr/libexec/ddx/panel-job show") &&
          same(ORDER("job", "stop"), "/usr/libexec/ddx/panel-job stop") && same(ORDER("job", "begin"), ""));
}

static void test_orders_that_are_refused(void) {
    static const char *const names[] = {"",       ";reboot", "a;reboot", "$(reboot)", "a b", "-help",
                                        "--json", "../x",    "a/b",      "a.b.c",     ".a",  "a.",
                                        "a\nb",   "a.b/c",   "a.\x1b[",  "lastboot*", "*",   "a\xc3\xbc"};
    static char longest[65];

    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        CHECK(same(ORDER("restart", names[i]), ""));
        CHECK(same(reason, "is not the name of a service"));
    }
    memset(longest, 'a', 64);
    CHECK(same(ORDER("logs", longest), ""));
    longest[63] = 0;
    CHECK(!same(ORDER("logs", longest), ""));
    CHECK(same(ORDER("reset", "everything"), "") && same(reason, "there is no such order"));
    CHECK(same(ORDER("health", "--json"), "") && same(ORDER("restart"), "") && same(ORDER("restart", "a", "b"), ""));
    CHECK(same(ORDER("/bin/sh"), "") && same(ORDER("Health"), "") && same(ORDER("healt"), "") &&
          same(ORDER("SERVICE"), ""));
    CHECK(same(find((const char *const[]){NULL}), ""));
}

struct output {
    char text[1024];
    size_t size, wanted;
};

static bool take(void *to, const char *bytes, size_t size) {
    struct output *output = to;

    CHECK(output->size + size < sizeof output->text);
    memcpy(output->text + output->size, bytes, size);
    output->size += size;
    return output->size < output->wanted;
}

static struct run run(unsigned seconds, size_t limit, struct output *output, const char *const *words) {
    struct run run;

    *output = (struct output){.wanted = output->wanted ? output->wanted : sizeof output->text};
    CHECK_EQUAL(run_program(words, &(const struct run_for){seconds, limit, -1, take, output, false}, &run), 0);
    return run;
}

#define RUN(seconds, limit, ...) run(seconds, limit, &output, (const char *const[]){__VA_ARGS__, NULL})
#define SHELL "/bin/sh", "-c" /* of this test, to have a program that does several things */

static void test_a_program_gets_its_words_and_nothing_else(void) {
    struct output output = {.wanted = 0};

    setenv("SECRET", "secret", 1);
    int secret = dup(STDIN_FILENO); /* without close-on-exec */
    CHECK(secret >= 0);
    struct run end = RUN(20, 1000, "/bin/echo", "$HOME", ";reboot", "`id`");
    CHECK(end.end == RUN_EXITED && !end.status && same(output.text, "$HOME ;reboot `id`\n"));
    end = RUN(20, 1000, "/usr/bin/env");
    CHECK(same(output.text, "PATH=/usr/sbin:/usr/bin:/sbin:/bin\n"));
    end = RUN(20, 1000, SHELL, "echo said; echo wrong >&2; cat; ls /proc/self/fd; exit 3");
    CHECK(end.end == RUN_EXITED && end.status == 3);
    CHECK(same(output.text, "said\nwrong\n0\n1\n2\n3\n")); /* 3: the folder that ls reads */
    close(secret);
}

static void test_limits(void) {
    struct output output = {.wanted = 1};
    struct run end = RUN(60, 1000, SHELL, "sleep 1000 & echo $$ $!; wait");
    int first, second, status;

    CHECK(end.end == RUN_NOT_WANTED && end.status == SIGKILL);
    CHECK_EQUAL(sscanf(output.text, "%d %d", &first, &second), 2);
    CHECK(kill(first, 0) && errno == ESRCH);
    kill(second, SIGTERM); /* too late, if the child of the shell was killed with it */
    CHECK(waitpid(second, &status, 0) == second && WIFSIGNALED(status));
    CHECK_EQUAL(WTERMSIG(status), SIGKILL);
    output.wanted = 0;
    end = RUN(1, 1000, SHELL, "echo a; exec sleep 1000");
    CHECK(end.end == RUN_TOO_LONG && end.status == SIGKILL);
    end = RUN(1, 1000, SHELL, "exec > /dev/null 2>&1; exec sleep 1000"); /* its output ends before it does */
    CHECK_EQUAL(end.end, RUN_TOO_LONG);
    end = RUN(60, 1000, SHELL, "yes");
    CHECK(end.end == RUN_TOO_MUCH && output.size <= 1000);
    end = RUN(60, 1000, SHELL, "kill -9 $$");
    CHECK(end.end == RUN_KILLED && end.status == SIGKILL);
    const struct run_for limits = {1, 1, -1, take, &output, false};
    CHECK_EQUAL(run_program((const char *const[]){"/no/such", NULL}, &limits, &end), -ENOENT);
}

static void test_what_a_program_leaves_behind_goes_on(void) {
    struct output output = {.wanted = 0};
    struct run end = RUN(60, 1000, SHELL, "sleep 1000 > /dev/null 2>&1 & echo $!"); /* as the copy of the settings */
    int left, status;

    CHECK(end.end == RUN_EXITED && sscanf(output.text, "%d", &left) == 1);
    CHECK(!kill(left, SIGTERM) && waitpid(left, &status, 0) == left && WIFSIGNALED(status));
    CHECK_EQUAL(WTERMSIG(status), SIGTERM); /* not SIGKILL before */
}

static struct in6_addr address(const char *text) {
    struct in6_addr found;

    CHECK(guess_address(text, &found));
    return found;
}

static bool one_visitor(const char *one, const char *other) {
    struct in6_addr a = address(one), b = address(other);

    return !memcmp(&a, &b, sizeof a);
}

static void test_addresses(void) {
    struct in6_addr none;

    CHECK(one_visitor("192.168.1.5", "::ffff:192.168.1.5") && !one_visitor("192.168.1.5", "192.168.1.6"));
    CHECK(!one_visitor("::ffff:192.168.1.5", "::ffff:192.168.1.6"));
    CHECK(one_visitor("2001:db8:1:2::5", "2001:db8:1:2:ffff::6") && !one_visitor("2001:db8:1:2::5", "2001:db8:1:3::5"));
    CHECK(!guess_address("", &none) && !guess_address("robot1", &none) && !guess_address("1.2.3", &none));
}

static void test_guesses(void) {
    static struct guesses guesses;
    static const int64_t blocks[] = {1000, 2000, 4000, 8000, 16000, 32000, 60000, 60000};
    const struct in6_addr mine = address("10.0.0.1"), other = address("10.0.0.2");
    int64_t now = 5000;

    for (size_t i = 0; i < sizeof blocks / sizeof blocks[0]; i++) {
        CHECK_EQUAL(guess_wait(&guesses, &mine, now), 0);
        guess_was_wrong(&guesses, &mine, now);
        CHECK_EQUAL(guess_wait(&guesses, &mine, now), blocks[i]);
        CHECK_EQUAL(guess_wait(&guesses, &mine, now + blocks[i] - 1), 1);
        CHECK_EQUAL(guess_wait(&guesses, &other, now), 0);
        now += blocks[i];
    }
    guess_was_wrong(&guesses, &mine, now);
    now += 60000 + 600000; /* long after */
    guess_was_wrong(&guesses, &mine, now);
    CHECK_EQUAL(guess_wait(&guesses, &mine, now), 1000);
    guess_was_wrong(&guesses, &mine, now + 1000);
    guess_was_right(&guesses, &mine);
    CHECK_EQUAL(guess_wait(&guesses, &mine, now + 1000), 0);
    guess_was_wrong(&guesses, &mine, now + 1000);
    CHECK_EQUAL(guess_wait(&guesses, &mine, now + 1000), 1000);
}

static void test_many_addresses_guess(void) {
    static struct guesses guesses;
    const struct in6_addr mine = address("10.0.0.1");
    char text[32];

    for (int i = 0; i < 6; i++)
        guess_was_wrong(&guesses, &mine, 1000); /* blocked for 32 s */
    for (int i = 0; i < 3 * GUESS_ADDRESSES; i++) {
        snprintf(text, sizeof text, "10.1.%d.%d", i / 256, i % 256);
        const struct in6_addr next = address(text);
        guess_was_wrong(&guesses, &next, 1000);
        CHECK_EQUAL(guess_wait(&guesses, &next, 1000), 1000);
    }
    CHECK_EQUAL(guess_wait(&guesses, &mine, 1000), 32000); /* those that are blocked for a shorter time made room */
}

static void test_comparison(void) {
    CHECK(secret_is("open sesame", "open sesame") && secret_is("", ""));
    CHECK(!secret_is("open sesame", "open sesamf") && !secret_is("open sesame", "pen sesame"));
    CHECK(!secret_is("aa", "a") && !secret_is("a", "aa") && !secret_is("", "a") && !secret_is("a", ""));
}

static void test_links(void) {
    struct link link = {.end = 0};
    char first[SECRET_TEXT + 1], wrong[SECRET_TEXT + 1];

    CHECK(!link_use(&link, 0, "") && !link_use(&link, 0, "0"));
    CHECK_EQUAL(link_make(&link, 100), 0);
    strcpy(first, link.text);
    strcpy(wrong, link.text);
    CHECK_EQUAL(strspn(first, "0123456789abcdef"), SECRET_TEXT);
    wrong[SECRET_TEXT - 1] = wrong[SECRET_TEXT - 1] == '0' ? '1' : '0';
    CHECK(!link_use(&link, 100, wrong) && !link_use(&link, 100, ""));
    CHECK(!link_use(&link, 100 + LINK_SECONDS, first));
    CHECK(link_use(&link, 99 + LINK_SECONDS, first));
    CHECK(!link_use(&link, 99 + LINK_SECONDS, first) && !link_use(&link, 99, "")); /* once */
    CHECK_EQUAL(link_make(&link, 100), 0);
    CHECK(strcmp(link.text, first) != 0);
    strcpy(first, link.text);
    CHECK_EQUAL(link_make(&link, 101), 0);
    CHECK(!link_use(&link, 101, first)); /* the newer one counts */
}

static void test_a_link_that_was_left_in_a_file(void) {
    char folder[] = "/tmp/ddx-link-XXXXXX", path[64], text[SECRET_TEXT + 1];
    struct link link;

    CHECK(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/link", folder);
    CHECK(!link_take(path, 100, ""));
    CHECK(!link_make(&link, 100) && !link_leave(&link, path));
    strcpy(text, link.text);
    CHECK(!link_take(path, 100, "0") && !link_take(path, 100 + LINK_SECONDS, text));
    CHECK(link_take(path, 101, text) && !link_take(path, 101, text));
    CHECK(!link_make(&link, 100) && !link_leave(&link, path));
    CHECK(!link_take(path, 100, text)); /* the newer one counts */
    CHECK(!truncate(path, sizeof link - 1));
    CHECK(!link_take(path, 100, link.text));
    CHECK(!unlink(path) && !symlink("/etc/passwd", path) && !link_leave(&link, path));
    CHECK(link_take(path, 100, link.text)); /* the name was replaced, not followed */
    CHECK(!rmdir(folder));
}

int main(void) {
    CHECK(!prctl(PR_SET_CHILD_SUBREAPER, 1));
    test_orders();
    test_orders_that_are_refused();
    test_streams();
    test_recordings_that_are_refused();
    test_a_program_gets_its_words_and_nothing_else();
    test_limits();
    test_what_a_program_leaves_behind_goes_on();
    test_addresses();
    test_guesses();
    test_many_addresses_guess();
    test_comparison();
    test_links();
    test_a_link_that_was_left_in_a_file();
    return 0;
}
