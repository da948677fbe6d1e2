/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The panel's web process: requests of lighttpd, words of orders, sessions. */
#include "check.h"
#include "download.h"
#include "guard.h"
#include "picture.h"
#include "scgi.h"

#include <errno.h>
#include <stdbool.h>

#define HEAD(length)                     \
    "CONTENT_LENGTH\0" length "\0SCGI\0" \
    "1\0REQUEST_METHOD\0POST\0HTTP_HOST\0robot1.local\0"

/* A request in memory of exactly its size, so that sanitizers see each byte that is read beyond it. */
static char *made(const char *head, size_t head_size, const char *body, size_t body_size, size_t *size) {
    char *request = malloc(head_size + body_size + 16);
    int digits = request ? snprintf(request, 16, "%zu:", head_size) : 0;

    CHECK(request);
    memcpy(request + digits, head, head_size);
    request[(size_t)digits + head_size] = ',';
    if (body_size)
        memcpy(request + digits + head_size + 1, body, body_size);
    *size = (size_t)digits + head_size + 1 + body_size;
    return request;
}

static int parsed(const char *head, size_t head_size, const char *body, size_t body_size) {
    struct scgi request;
    size_t size;
    char *bytes = made(head, head_size, body, body_size, &size);
    int result = scgi_parse(bytes, size, &request);

    free(bytes);
    return result;
}

#define PARSED(head, body) parsed(head, sizeof head - 1, body, sizeof body - 1)

static void test_a_request_is_complete_with_its_last_byte(void) {
    static const char head[] = HEAD("5");
    struct scgi request;
    size_t size;
    char *bytes = made(head, sizeof head - 1, "hello more", 10, &size);

    for (size_t have = 0; have <= size; have++) {
        char *part = malloc(have + 1);
        CHECK(part);
        memcpy(part, bytes, have);
        CHECK_EQUAL(scgi_parse(part, have, &request), have >= size - 5);
        free(part);
    }
    CHECK_EQUAL(scgi_parse(bytes, size, &request), 1);
    CHECK(request.body_size == 5 && !memcmp(request.body, "hello", 5));
    CHECK(!strcmp(scgi_value(&request, "HTTP_HOST"), "robot1.local"));
    CHECK(!strcmp(scgi_value(&request, "REQUEST_METHOD"), "POST"));
    CHECK(!scgi_value(&request, "robot1.local") && !scgi_value(&request, "HTTP_HOS") && !scgi_value(&request, ""));
    free(bytes);
}

static void test_what_is_not_a_request(void) {
    CHECK_EQUAL(PARSED(HEAD("0"), ""), 1);
    CHECK_EQUAL(PARSED("SCGI\0"
                       "1\0CONTENT_LENGTH\0"
                       "0\0",
                       ""),
                -EBADMSG); /* the order of the protocol */
    CHECK_EQUAL(PARSED("CONTENT_LENGTH\0"
                       "0\0SCGI\0"
                       "2\0",
                       ""),
                -EBADMSG);
    CHECK_EQUAL(PARSED("CONTENT_LENGTH\0"
                       "0\0",
                       ""),
                -EBADMSG);
    CHECK_EQUAL(PARSED("CONTENT_LENGTH\0"
                       "0\0SCGI\0"
                       "1\0X\0",
                       ""),
                -EBADMSG); /* no value */
    CHECK_EQUAL(PARSED("CONTENT_LENGTH\0"
                       "0\0SCGI\0"
                       "1\0X\0y",
                       ""),
                -EBADMSG); /* not terminated */
    CHECK_EQUAL(PARSED("CONTENT_LENGTH\0"
                       "0\0SCGI\0"
                       "1\0\0y\0",
                       ""),
                -EBADMSG); /* no name */
    CHECK_EQUAL(PARSED(HEAD("0") "X\0a\r\nSet-Cookie: b\0", ""), -EBADMSG);
    CHECK_EQUAL(PARSED(HEAD("0") "X\0a\x7f\0", ""), -EBADMSG);
    CHECK_EQUAL(PARSED(HEAD("0") "HTTP_HOST\0evil\0", ""), -EBADMSG); /* twice */
    CHECK_EQUAL(PARSED(HEAD("-1"), ""), -EBADMSG);
    CHECK_EQUAL(PARSED(HEAD(""), ""), -EBADMSG);
    CHECK_EQUAL(PARSED(HEAD("1x"), "ab"), -EBADMSG);
    CHECK_EQUAL(PARSED(HEAD("01"), "a"), -EBADMSG);
    CHECK_EQUAL(PARSED(HEAD("99999999"), ""), -EMSGSIZE);
    CHECK_EQUAL(PARSED(HEAD("999999999999999999999"), ""), -EBADMSG);
    CHECK_EQUAL(PARSED("", ""), -EBADMSG);
}

static void test_broken_netstrings(void) {
    static const char *const texts[] = {":", "x", "-1:", "007:", "99999:", "16385:", "123456789:", "5;hello,"};
    struct scgi request;

    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++)
        CHECK_EQUAL(scgi_parse(texts[i], strlen(texts[i]), &request), -EBADMSG);
    CHECK_EQUAL(scgi_parse("5:hello.", 8, &request), -EBADMSG);
    CHECK_EQUAL(scgi_parse("12", 2, &request), 0);
    CHECK_EQUAL(scgi_parse("16384:", 6, &request), 0);
}

static void test_hosts(void) {
    static const char *const own[] = {"robot1",      "robot1.local", "ROBOT1.Local:443", "localhost:8443", "localhost",
                                      "192.168.1.5", "10.0.0.1:443", "[fe80::1]",        "[::1]:8443"};
    static const char *const foreign[] = {"",
                                          "evil.example",
                                          "robot1.evil.example",
                                          "robot1.local.evil.example",
                                          "robot10",
                                          "robot",
                                          "robot1.localx",
                                          "robot1.",
                                          ".local",
                                          "robot1:",
                                          "robot1:4x",
                                          "robot1:443:1",
                                          "[::1",
                                          "[]",
                                          "[robot1]",
                                          "::1",
                                          "192.168.1",
                                          "1.2.3.4.evil.example",
                                          "[::1]x",
                                          "robot1/",
                                          "[",
                                          "robot1@evil.example"};

    for (size_t i = 0; i < sizeof own / sizeof own[0]; i++)
        CHECK(guard_host(own[i], "robot1"));
    for (size_t i = 0; i < sizeof foreign / sizeof foreign[0]; i++)
        CHECK(!guard_host(foreign[i], "robot1"));
    CHECK(!guard_host("", "") && !guard_host(".local", ""));
}

/* The status of a request with these headers, each with its 0 byte. */
static int guarded(const char *head, size_t size, bool order) {
    struct scgi request;
    size_t whole;
    char *bytes = made(head, size, "", 0, &whole);

    CHECK_EQUAL(scgi_parse(bytes, whole, &request), 1);
    int status = guard_request(&request, "robot1", order);
    free(bytes);
    return status;
}

#define BEGIN          \
    "CONTENT_LENGTH\0" \
    "0\0SCGI\0"        \
    "1\0"
#define GUARDED(head, order) guarded(BEGIN head, sizeof BEGIN head - 1, order)
#define POST "REQUEST_METHOD\0POST\0"
#define GET "REQUEST_METHOD\0GET\0"
#define HOST "HTTP_HOST\0robot1.local\0"
#define ORIGIN "HTTP_ORIGIN\0https://robot1.local\0"
#define PANEL        \
    "HTTP_X_PANEL\0" \
    "1\0"

static void test_foreign_pages(void) {
    CHECK_EQUAL(GUARDED(POST HOST ORIGIN PANEL, true), 0);
    CHECK_EQUAL(GUARDED(GET HOST, false), 0);
    CHECK_EQUAL(GUARDED(GET HOST ORIGIN PANEL, true), 405);
    CHECK_EQUAL(GUARDED(POST HOST, false), 405);
    CHECK_EQUAL(GUARDED("REQUEST_METHOD\0post\0" HOST ORIGIN PANEL, true), 405);
    CHECK_EQUAL(GUARDED(HOST ORIGIN PANEL, true), 405);
    CHECK_EQUAL(GUARDED(POST ORIGIN PANEL, true), 403);
    CHECK_EQUAL(GUARDED(GET, false), 403);
    CHECK_EQUAL(GUARDED(GET "HTTP_HOST\0evil.example\0", false), 403);
    CHECK_EQUAL(GUARDED(POST "HTTP_HOST\0evil.example\0HTTP_ORIGIN\0https://evil.example\0" PANEL, true), 403);
    CHECK_EQUAL(GUARDED(POST HOST PANEL, true), 403);
    CHECK_EQUAL(GUARDED(POST HOST ORIGIN, true), 403);
    CHECK_EQUAL(GUARDED(POST HOST PANEL "HTTP_ORIGIN\0http://robot1.local\0", true), 403);
    CHECK_EQUAL(GUARDED(POST HOST PANEL "HTTP_ORIGIN\0https://evil.example\0", true), 403);
    CHECK_EQUAL(GUARDED(POST HOST PANEL "HTTP_ORIGIN\0https://robot1.local:8443\0", true), 403);
    CHECK_EQUAL(GUARDED(POST HOST PANEL "HTTP_ORIGIN\0null\0", true), 403);
}

static bool cookie_is(const char *cookies, const char *value) {
    size_t size = 0;
    const char *found = scgi_cookie(cookies, "__Host-panel", &size);

    return value ? found && size == strlen(value) && !memcmp(found, value, size) : !found;
}

static void test_cookies(void) {
    CHECK(cookie_is("__Host-panel=abc", "abc"));
    CHECK(cookie_is("a=b; __Host-panel=abc;c=d", "abc"));
    CHECK(cookie_is("__Host-panel=", ""));
    CHECK(cookie_is("", NULL) && cookie_is("__Host-panel", NULL) && cookie_is(";;; ;", NULL));
    CHECK(cookie_is("x__Host-panel=abc", NULL) && cookie_is("a=__Host-panel=abc", NULL));
    CHECK(cookie_is("__Host-panel=abc; __Host-panel=abc", NULL));
}

static void test_words(void) {
    struct words words;
    char text[WORDS_SIZE + 1];

    CHECK_EQUAL(words_split(&words, "restart\nddxvideosave\n", 21), 0);
    CHECK(words.count == 2 && !words.word[2]);
    CHECK(!strcmp(words.word[0], "restart") && !strcmp(words.word[1], "ddxvideosave"));
    CHECK_EQUAL(words_split(&words, "a b;c", 5), 0); /* a word may be anything that is visible: nothing executes it */
    CHECK(words.count == 1 && !strcmp(words.word[0], "a b;c"));
    CHECK_EQUAL(words_split(&words, "", 0), -EINVAL);
    CHECK_EQUAL(words_split(&words, "\n", 1), -EINVAL);
    CHECK_EQUAL(words_split(&words, "a\n\nb", 4), -EINVAL);
    CHECK_EQUAL(words_split(&words, "a\0b", 3), -EINVAL);
    CHECK_EQUAL(words_split(&words, "a\r\n", 3), -EINVAL);
    CHECK_EQUAL(words_split(&words, "\x1b[2J", 4), -EINVAL);
    CHECK_EQUAL(words_split(&words, "m\xfc", 2), -EINVAL);
    for (unsigned i = 0; i <= WORDS_MAX; i++)
        memcpy(text + 2 * i, "a\n", 2);
    CHECK_EQUAL(words_split(&words, text, 2 * WORDS_MAX), 0);
    CHECK(words.count == WORDS_MAX && !words.word[WORDS_MAX]);
    CHECK_EQUAL(words_split(&words, text, 2 * WORDS_MAX + 2), -E2BIG);
    memset(text, 'a', sizeof text);
    CHECK_EQUAL(words_split(&words, text, WORDS_SIZE - 1), 0);
    CHECK_EQUAL(strlen(words.word[0]), WORDS_SIZE - 1);
    CHECK_EQUAL(words_split(&words, text, WORDS_SIZE), -E2BIG);
}

static unsigned find(const struct sessions *sessions, int64_t now, const char *text) {
    return session_find(sessions, now, text, strlen(text));
}

static void test_sessions(void) {
    static struct sessions sessions;
    char text[SESSIONS + 1][SECRET_TEXT + 1], wrong[SECRET_TEXT + 1];

    CHECK_EQUAL(session_begin(&sessions, 100, text[0]), 1);
    CHECK_EQUAL(strspn(text[0], "0123456789abcdef"), SECRET_TEXT);
    CHECK_EQUAL(find(&sessions, 100, text[0]), 1);
    CHECK_EQUAL(find(&sessions, 99 + SESSION_SECONDS, text[0]), 1);
    CHECK_EQUAL(find(&sessions, 100 + SESSION_SECONDS, text[0]), 0);
    for (size_t i = 0; i < SECRET_TEXT; i++) { /* each digit counts */
        strcpy(wrong, text[0]);
        wrong[i] = wrong[i] == '0' ? '1' : '0';
        CHECK_EQUAL(find(&sessions, 100, wrong), 0);
    }
    CHECK_EQUAL(session_find(&sessions, 100, text[0], SECRET_TEXT - 1), 0);
    CHECK_EQUAL(find(&sessions, 100, ""), 0);
    CHECK_EQUAL(find(&sessions, 100, "00000000000000000000000000000000"), 0); /* the key of a free one */
    for (int i = 1; i <= SESSIONS; i++) {
        CHECK_EQUAL(session_begin(&sessions, 100 + i, text[i]), i + 1);
        CHECK(strcmp(text[i], text[i - 1]) != 0);
    }
    CHECK_EQUAL(find(&sessions, 200, text[0]), 0); /* the oldest one made room */
    for (int i = 1; i <= SESSIONS; i++)
        CHECK_EQUAL(find(&sessions, 200, text[i]), i + 1);
    session_end(&sessions, 3);
    CHECK_EQUAL(find(&sessions, 200, text[2]), 0);
    CHECK_EQUAL(session_begin(&sessions, 300, text[0]), SESSIONS + 2);
    CHECK_EQUAL(find(&sessions, 300, text[1]), 2); /* the place of the ended one was taken */
}

#define LONGEST_ITEM "123456789.123456789.123456789.123456789.123456789.123456789.123"

static bool wants(const char *text, const char *item, uint64_t after, int quality, int divisor) {
    struct picture_wanted wanted;

    return picture_parse(&wanted, text) && !strcmp(wanted.item, item) && wanted.after == after &&
           wanted.form.quality == quality && wanted.form.divisor == divisor;
}

static void test_pictures_that_are_wanted(void) {
    static const char *const wrong[] = {"",
                                        "?after=1",
                                        "/etc/passwd",
                                        "a/b",
                                        "a%2fb",
                                        "a b",
                                        "a%20b",
                                        "a%0ab",
                                        "a%00b",
                                        "a%7f",
                                        "a%",
                                        "a%4",
                                        "a%4g",
                                        "a%-1",
                                        "m\xfc",
                                        LONGEST_ITEM "4",
                                        "video?",
                                        "video?after=",
                                        "video?after=-1",
                                        "video?after=+1",
                                        "video?after= 1",
                                        "video?after=1x",
                                        "video?after=99999999999999999999",
                                        "video?quality=1",
                                        "video?quality=32",
                                        "video?divisor=0",
                                        "video?divisor=3",
                                        "video?after=1&",
                                        "video?after=1&&quality=3",
                                        "video?more=1",
                                        "video?after=1?quality=3",
                                        "video?after",
                                        "video&after=1 "};
    struct picture_wanted wanted;

    CHECK(wants("video", "video", 0, 6, 1));
    CHECK(wants("video?after=12&quality=16&divisor=2", "video", 12, 16, 2));
    CHECK(wants("video?divisor=2&after=9223372036854775807", "video", INT64_MAX, 6, 2));
    CHECK(wants("carol%3Avideo.rear?quality=2", "carol:video.rear", 0, 2, 1));
    CHECK(wants("-name", "-name", 0, 6, 1)); /* it follows an option, and is none */
    CHECK(wants(LONGEST_ITEM, LONGEST_ITEM, 0, 6, 1));
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        if (picture_parse(&wanted, wrong[i]))
            CHECK_EQUAL(i, 1000);
}

static void test_pictures_that_are_heard(void) {
    static const char *const wrong[] = {"",
                                        "picture",
                                        "picture ",
                                        "picture 1 2 3 4",
                                        "picture 1 2 3 4 5 6",
                                        "picture 0 2 3 4 5",
                                        "picture 1 2 3 4 0",
                                        "picture 1 2 3 4 -5",
                                        "picture -1 2 3 4 5",
                                        "picture 1 2 3 4 5x",
                                        "picture 1 2 3 4 99999999999999999999",
                                        "picture a 2 3 4 5",
                                        "nothing else",
                                        "refused"};
    struct picture_said said;

    CHECK(picture_hear(&said, "picture 1234567890123 -7 40000 3 1048576"));
    CHECK(said.kind == PICTURE_NEW && said.sequence == 1234567890123 && said.frame == -7 && said.age == 40000);
    CHECK(said.lost == 3 && said.size == PICTURE_MAX);
    CHECK(picture_hear(&said, "picture 1 2 3 4 1048577") && said.kind == PICTURE_TOO_LARGE);
    CHECK(picture_hear(&said, "nothing") && said.kind == PICTURE_NOTHING);
    CHECK(picture_hear(&said, "refused for a reason") && said.kind == PICTURE_REFUSED);
    CHECK(!strcmp(said.reason, "for a reason"));
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        if (picture_hear(&said, wrong[i]))
            CHECK_EQUAL(i, 1000);
}

static bool fetches(const char *text, const char *range, const char *if_range, const char *name, uint64_t first,
                    uint64_t last) {
    struct download wanted;

    return download_parse(&wanted, text, range, if_range) && !strcmp(wanted.name, name) && wanted.first == first &&
           wanted.last == last && wanted.is_part == (first || last != UINT64_MAX);
}

static void test_files_that_are_wanted(void) {
    static const char *const wrong[] = {"", "a/b", "a%2fb", "a b", "a%0d%0aX: y", "a%00", "m\xfc"};
    static const char *const whole[] = {"bytes=-5",
                                        "bytes=5",
                                        "bytes=1-2,4-5",
                                        "bytes=9-8",
                                        "bytes=1-x",
                                        "bytes=+1-",
                                        "bytes= 1-",
                                        "items=1-2",
                                        "",
                                        "bytes=1--",
                                        "bytes=9999999999999999999-"};
    struct download wanted;

    CHECK(fetches("a.mp4", NULL, NULL, "a.mp4", 0, UINT64_MAX));
    CHECK(fetches("carol%3Avideo.mp4", "bytes=100-", NULL, "carol:video.mp4", 100, UINT64_MAX));
    CHECK(fetches("a.mp4", "bytes=100-199", NULL, "a.mp4", 100, 199) && fetches("a", "bytes=7-7", NULL, "a", 7, 7));
    CHECK(fetches("a.mp4", "bytes=7-", "\"a.mp4\"", "a.mp4", 7, UINT64_MAX));
    CHECK(fetches("a.mp4", "bytes=7-", "\"b.mp4\"", "a.mp4", 0, UINT64_MAX)); /* the rest of another file */
    CHECK(fetches("a.mp4", "bytes=7-", "a.mp4", "a.mp4", 0, UINT64_MAX));
    CHECK(fetches("a.mp4", "bytes=7-", "\"a.mp4\"x", "a.mp4", 0, UINT64_MAX));
    for (size_t i = 0; i < sizeof whole / sizeof *whole; i++)
        if (!fetches("a", whole[i], NULL, "a", 0, UINT64_MAX))
            CHECK_EQUAL(i, 1000);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        if (download_parse(&wanted, wrong[i], NULL, NULL))
            CHECK_EQUAL(i, 1000);
}

static bool limited(uint64_t first, uint64_t last, uint64_t size, uint64_t bytes) {
    struct download wanted = {.is_part = true, .first = first, .last = last};

    return download_limit(&wanted, size) && wanted.last + 1 - wanted.first == bytes;
}

static void test_files_of_a_size(void) {
    struct download whole = {.is_part = false, .last = UINT64_MAX};
    uint64_t size = 0;

    CHECK(limited(0, UINT64_MAX, 10, 10) && limited(9, UINT64_MAX, 10, 1) && limited(2, 4, 10, 3));
    CHECK(limited(2, 99, 10, 8) && !limited(10, UINT64_MAX, 10, 0) && !limited(0, 5, 0, 0));
    CHECK(download_limit(&whole, 0) && whole.last + 1 == 0);
    CHECK(download_hear(&size, "1234\nabc", 8) == 5 && size == 1234);
    CHECK(download_hear(&size, "0\n", 2) == 2 && size == 0);
    CHECK(!download_hear(&size, "", 0) && !download_hear(&size, "\n", 1) && !download_hear(&size, "1234", 4));
    CHECK(!download_hear(&size, "12 \n", 4) && !download_hear(&size, "9999999999999999999\n", 20));
}

int main(void) {
    test_a_request_is_complete_with_its_last_byte();
    test_what_is_not_a_request();
    test_broken_netstrings();
    test_hosts();
    test_foreign_pages();
    test_cookies();
    test_words();
    test_sessions();
    test_pictures_that_are_wanted();
    test_pictures_that_are_heard();
    test_files_that_are_wanted();
    test_files_of_a_size();
    return 0;
}
