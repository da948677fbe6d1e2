/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Declarations become layouts: the parser's offsets equal the compiler's. */
#include <errno.h>
#include <stddef.h>
#include <string.h>

#include "../../package/ddx/lib/memory.h"
#include "../../package/ddx/lib/type.h"
#include "check.h"

#define WIDE (4 * (2 + 1))
DDX_STORE_TYPE(
    POSE, struct {
        double x, y;
        float heading;
    });
DDX_STORE_TYPE(
    ROBOT, struct {
        char name[WIDE];
        short gears[2][3];
        POSE pose;
        struct {
            unsigned char id;
            long long ticks;
        } wheel[WIDE / 3];
        int64_t time;
        _Bool armed;
        const unsigned long int serial;
    });

static const struct ddx_layout_field *find(const struct ddx_layout *layout, const char *name) {
    for (unsigned i = 0; i < layout->field_count; i++)
        if (!strcmp(layout->field[i].name, name))
            return &layout->field[i];
    fprintf(stderr, "no field %s\n", name);
    exit(1);
}

#define CHECK_FIELD(member, a_kind, elements)                                    \
    do {                                                                         \
        const struct ddx_layout_field *f = find(layout, #member);                \
        CHECK_EQUAL(f->offset, offsetof(ROBOT, member));                         \
        CHECK_EQUAL(f->kind, a_kind);                                            \
        CHECK_EQUAL(f->count, elements);                                         \
        CHECK_EQUAL(f->bytes *(uint64_t)f->count, sizeof(((ROBOT *)0)->member)); \
    } while (0)

static void test_parse(void) {
    struct ddx_layout *layout;

    CHECK_EQUAL(ddx_layout_of("ROBOT", &layout), 0);
    CHECK_EQUAL(layout->size, sizeof(ROBOT));
    CHECK(ddx_layout_valid(layout, ddx_layout_bytes(layout->field_count)));
    CHECK_FIELD(name, DDX_KIND_CHAR, 12);
    CHECK_FIELD(gears, DDX_KIND_INT, 6);
    CHECK_FIELD(pose, DDX_KIND_STRUCT, 1);
    CHECK_FIELD(pose.y, DDX_KIND_FLOAT, 1);
    CHECK_FIELD(pose.heading, DDX_KIND_FLOAT, 1);
    CHECK_FIELD(wheel, DDX_KIND_STRUCT, 4);
    CHECK_FIELD(time, DDX_KIND_INT, 1);
    CHECK_FIELD(armed, DDX_KIND_UNSIGNED, 1);
    CHECK_FIELD(serial, DDX_KIND_UNSIGNED, 1);
    CHECK_EQUAL(find(layout, "wheel.ticks")->offset, offsetof(ROBOT, wheel[0].ticks));
    CHECK_EQUAL(find(layout, "wheel")->children, 2);
    free(layout);
}

/* Several names of one nested struct: each has its own fields. */
static void test_several_names(void) {
    typedef struct {
        char first;
        struct {
            struct {
                short a, b[3];
                double c;
            } deep, deeper[2];
            char last;
        } one, two[3];
    } SEVERAL;
    struct ddx_layout *layout;

    CHECK_EQUAL(ddx_layout_parse("struct { char first; struct { struct { short a, b[3]; double c; } deep, deeper[2]; "
                                 "char last; } one, two[3]; }",
                                 &layout),
                0);
    CHECK_EQUAL(layout->size, sizeof(SEVERAL));
    CHECK_EQUAL(layout->field_count, 1 + 2 * (1 + 2 * 4 + 1));
    CHECK(ddx_layout_valid(layout, ddx_layout_bytes(layout->field_count)));
    CHECK_EQUAL(find(layout, "one.deeper.c")->offset, offsetof(SEVERAL, one.deeper[0].c));
    CHECK_EQUAL(find(layout, "two")->children, 9);
    CHECK_EQUAL(find(layout, "two.deep.b")->offset, offsetof(SEVERAL, two[0].deep.b));
    CHECK_EQUAL(find(layout, "two.deeper.c")->offset, offsetof(SEVERAL, two[0].deeper[0].c));
    CHECK_EQUAL(find(layout, "two.last")->offset, offsetof(SEVERAL, two[0].last));
    free(layout);
}

/* 63 bytes are a name, 64 are not, also as the names of nested fields together. */
static void test_long_names(void) {
    struct ddx_layout *layout;
    char text[200];

    for (int length = DDX_NAME_MAX - 2; length <= DDX_NAME_MAX - 1; length++) {
        snprintf(text, sizeof text, "struct { struct { int %0*d; } a; }", length, 0);
        memset(strchr(text, '0'), 'x', (size_t)length);
        CHECK_EQUAL(ddx_layout_parse(text, &layout), length == DDX_NAME_MAX - 2 ? 0 : -EINVAL);
        if (length == DDX_NAME_MAX - 2)
            free(layout);
    }
}

static void test_refused(void) {
    static const char *const bad[] = {
        "",
        "int x",
        "void",
        "struct { }",
        "struct { int *p; }",
        "struct { int a : 3; }",
        "struct { int a[0]; }",
        "struct { int a[-1]; }",
        "struct { int a[1/0]; }",
        "struct { int a[2147483647][2147483647]; }",
        "struct { union { int a; } u; }",
        "struct { long double a; }",
        "struct { unknown_t a; }",
        "struct { int a; ",
        "struct { int a; } trailing",
        "struct { int a[9223372036854775807 + 1]; }",
        "struct { struct { struct { struct { struct { struct { struct { struct { struct { int a; } b; } c; } d; } e; } "
        "f; } "
        "g; } h; } i; }",
    };
    struct ddx_layout *layout;

    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        if (ddx_layout_parse(bad[i], &layout) == -EINVAL)
            continue;
        fprintf(stderr, "not refused: %s\n", bad[i]);
        exit(1);
    }
}

static void test_expressions(void) {
    static const struct {
        const char *text;
        uint32_t value;
    } cases[] = {{"1920*1080", 2073600},
                 {"(1920*1080)/4", 518400},
                 {"1+2*3", 7},
                 {"(1+2)*3", 9},
                 {"1<<4|3", 19},
                 {"0x10", 16},
                 {"10UL", 10},
                 {"-3+5", 2},
                 {"~0+2", 1},
                 {"100/7%5", 4},
                 {"7-2-1", 4},
                 {"010", 8}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct ddx_layout *layout;
        char text[80];

        snprintf(text, sizeof text, "struct { char a[%s]; }", cases[i].text);
        CHECK_EQUAL(ddx_layout_parse(text, &layout), 0);
        CHECK_EQUAL(layout->field[0].count, cases[i].value);
        free(layout);
    }
}

static struct ddx_layout *parsed(const char *text) {
    struct ddx_layout *layout;

    CHECK_EQUAL(ddx_layout_parse(text, &layout), 0);
    return layout;
}

static int match(const char *item, const char *own) {
    struct ddx_layout *a = parsed(item), *b = parsed(own);
    struct ddx_span *spans = NULL;
    unsigned count;
    int result = ddx_layout_match(a, b, &spans, &count);

    if (!result)
        free(spans);
    free(a);
    free(b);
    return result;
}

static void test_match(void) {
    CHECK_EQUAL(match("struct { int a; float b; }", "struct { int other; float names; }"), 0);
    CHECK_EQUAL(match("struct { int a; float b; }", "struct { float a; int b; }"), -EPROTOTYPE);
    CHECK_EQUAL(match("struct { int a; int b; }", "struct { int a; }"), -EMSGSIZE);
    CHECK_EQUAL(match("struct { int a[2]; }", "struct { int a; int b; }"), -EPROTOTYPE);
    CHECK_EQUAL(match("struct { struct { short x, y; } p; }", "struct { struct { int x; } p; }"), -EPROTOTYPE);
    CHECK_EQUAL(match("int", "int32_t"), 0);
    CHECK_EQUAL(match("int", "unsigned"), -EPROTOTYPE);
}

/* A picture in arrays that are too large for it: other bounds agree as long as the picture fits. */
static void test_extents(void) {
    struct ddx_layout *item = parsed("struct { int w; char y[2073600]; char u[518400]; int64_t time; }");
    struct ddx_layout *small = parsed("struct { int w; char y[1000]; char u[250]; }");
    struct ddx_layout *tiny = parsed("struct { int w; char y[999]; char u[250]; }");
    struct ddx_span *spans;
    struct ddx_runs runs;
    unsigned count;

    CHECK_EQUAL(ddx_layout_use(item, "y", 1000), 0);
    CHECK_EQUAL(ddx_layout_use(item, "u", 250), 0);
    CHECK_EQUAL(ddx_layout_use(item, "u", 518401), -EINVAL);
    CHECK_EQUAL(ddx_layout_use(item, "v", 1), -EINVAL);
    CHECK_EQUAL(ddx_layout_match(item, small, &spans, &count), 0);
    CHECK_EQUAL(count, 2); /* w and y are neighbours in both; u is not */
    CHECK_EQUAL(spans[0].bytes, 1004);
    CHECK_EQUAL(spans[1].own, 1004);
    CHECK_EQUAL(spans[1].item, 4 + 2073600);
    free(spans);
    CHECK_EQUAL(ddx_layout_match(item, tiny, &spans, &count), -EMSGSIZE);
    ddx_runs_of(item, &runs);
    CHECK_EQUAL(runs.count, 3);
    CHECK(runs.file_bytes <= 3 * ddx_page_round(1));
    free(item);
    free(small);
    free(tiny);
}

/* A grey picture has no colours: their arrays take no memory. But part of an item must be in use. */
static void test_no_extent(void) {
    struct ddx_layout *item = parsed("struct { int w; char y[2073600]; char u[518400]; int time; }");
    struct ddx_layout *own = parsed("struct { int w; char y[5000]; char u[1]; int time; }");
    struct ddx_layout *nothing = parsed("struct { char y[100]; }");
    size_t bytes = ddx_layout_bytes(item->field_count);
    struct ddx_span *spans;
    struct ddx_runs runs;
    unsigned count;

    CHECK_EQUAL(ddx_layout_use(item, "y", 5000), 0);
    CHECK_EQUAL(ddx_layout_use(item, "u", 0), 0);
    CHECK(ddx_layout_valid(item, bytes));
    ddx_runs_of(item, &runs);
    CHECK_EQUAL(runs.count, 2);
    CHECK_EQUAL(ddx_layout_match(item, own, &spans, &count), 0);
    CHECK_EQUAL(count, 2);
    CHECK_EQUAL(spans[1].item, 4 + 2073600 + 518400);
    free(spans);
    item->field[2].extent = 0;
    CHECK(!ddx_layout_valid(item, bytes));
    CHECK_EQUAL(ddx_layout_use(nothing, "y", 0), 0);
    CHECK(!ddx_layout_valid(nothing, ddx_layout_bytes(1)));
    free(item);
    free(own);
    free(nothing);
}

/* A layout from another program may contain anything. */
static void test_untrusted(void) {
    struct ddx_layout *layout = parsed("struct { int a; struct { int b; } c[2]; int d; }");
    size_t bytes = ddx_layout_bytes(layout->field_count);

    CHECK(ddx_layout_valid(layout, bytes));
    CHECK(!ddx_layout_valid(layout, bytes - 1));
    for (size_t i = 0; i < bytes; i++) {
        /* Must not crash, hang or read beyond; run under ASan too. */
        for (int bit = 0; bit < 8; bit++) {
            ((unsigned char *)layout)[i] ^= (unsigned char)(1 << bit);
            if (ddx_layout_valid(layout, bytes)) {
                struct ddx_runs runs;

                ddx_runs_of(layout, &runs);
                CHECK(runs.file_bytes <= runs.span_bytes);
            }
            ((unsigned char *)layout)[i] ^= (unsigned char)(1 << bit);
        }
    }
    free(layout);
}

int main(void) {
    test_parse();
    test_several_names();
    test_long_names();
    test_refused();
    test_expressions();
    test_match();
    test_extents();
    test_no_extent();
    test_untrusted();
    return 0;
}
