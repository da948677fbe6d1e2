/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Layouts as text and back: the type descriptions of a log, and those of a malformed file. */
#include "check.h"
#include "form.h"

#include <errno.h>

static const char deep[] = "struct { int8_t a; struct { double b; struct { int16_t c; } d[2]; char e[3]; } f[2]; "
                           "uint64_t gH_; }";

static const struct form_leaf *leaf_named(const struct form *form, const char *name) {
    for (unsigned i = 0; i < form->leaf_count; i++)
        if (!strcmp(form->leaves[i].name, name))
            return &form->leaves[i];
    fprintf(stderr, "no %s\n", name);
    exit(1);
}

/* CDR aligns numbers by their size, counted from the end of its header, and does not align structs. */
static void test_places(void) {
    struct form *form;
    CHECK_EQUAL(form_of_text("DEEP_one", deep, "", &form), 0);
    CHECK(!strcmp(form->declaration, deep));
    CHECK(!strcmp(form->schema_name, "ddx/msg/DEEPOne"));
    CHECK_EQUAL(leaf_named(form, "a")->message, 4);
    CHECK_EQUAL(leaf_named(form, "f[0].b")->message, 4 + 8);
    CHECK_EQUAL(leaf_named(form, "f[0].d[1].c")->message, 4 + 18);
    CHECK_EQUAL(leaf_named(form, "f[0].e")->message, 4 + 20);
    CHECK_EQUAL(leaf_named(form, "f[1].b")->message, 4 + 24);
    CHECK_EQUAL(leaf_named(form, "gH_")->message, 4 + 40);
    CHECK_EQUAL(form->message_size, 4 + 48);
    CHECK(strstr(form->schema, "int8 a\nddx/DEEPOneF[2] f\nuint64 g_h\n====="));
    CHECK(strstr(form->schema, "=\nMSG: ddx/DEEPOneF\nfloat64 b\nddx/DEEPOneFD[2] d\nuint8[3] e\n"));
    form_free(form);
}

static void test_extents(void) {
    struct form *form;
    CHECK_EQUAL(form_of_text("V", "struct { char y[100]; char u[25]; int32_t n; }", "y=8 u=2", &form), 0);
    CHECK_EQUAL(form->message_size, 4 + 16);
    CHECK_EQUAL(leaf_named(form, "n")->message, 4 + 12);
    CHECK(!strcmp(form->extents, "y=8 u=2"));
    CHECK(strstr(form->schema, "uint8[8] y\nuint8[2] u\n"));
    form_free(form);
}

/* A field without used bytes is in the declaration, but neither in the message nor in ROS's schema. */
static void test_a_field_without_bytes(void) {
    struct form *form;
    CHECK_EQUAL(form_of_text("V", "struct { uint8_t y[100]; uint8_t u[25]; int32_t n; }", "y=8 u=0", &form), 0);
    CHECK_EQUAL(form->message_size, 4 + 12);
    CHECK_EQUAL(form->leaf_count, 2);
    CHECK_EQUAL(leaf_named(form, "n")->message, 4 + 8);
    CHECK(!strcmp(form->extents, "y=8 u=0"));
    CHECK(!strcmp(form->schema, "uint8[8] y\nint32 n\n"));
    form_free(form);
}

static void test_names_that_meet(void) {
    struct form *form;
    CHECK_EQUAL(form_of_text("1", "struct { int8_t aB; int8_t a_b; int8_t _; int8_t X9; }", "", &form), 0);
    CHECK(!strcmp(form->schema, "int8 a_b\nint8 a_b_again2\nint8 f\nint8 x9\n"));
    CHECK(!strcmp(form->schema_name, "ddx/msg/T1"));
    form_free(form);
    CHECK_EQUAL(form_of_text("int", "int32_t", "", &form), 0);
    CHECK(!strcmp(form->schema, "int32 value\n") && form->message_size == 8);
    form_free(form);
}

/* The text of a form is parsed into the same form. */
static void test_it_is_read_again(void) {
    static const char *const texts[][2] = {
        {"struct{ int8_t a;  struct {float b;} c[2]; }", "struct { int8_t a; struct { float b; } c[2]; }"},
        {"int16_t", "int16_t"}};
    for (size_t i = 0; i < sizeof(texts) / sizeof(*texts); i++) {
        struct form *form, *again;
        CHECK_EQUAL(form_of_text("T", texts[i][0], "", &form), 0);
        CHECK(!strcmp(form->declaration, texts[i][1]));
        CHECK_EQUAL(form_of_text("T", form->declaration, "", &again), 0);
        CHECK_EQUAL(again->message_size, form->message_size);
        form_free(again);
        form_free(form);
    }
}

static void test_what_is_no_declaration(void) {
    static const char *const bad[] = {"",
                                      "struct { }",
                                      "struct {",
                                      "struct { int8_t }",
                                      "struct { int8_t a }",
                                      "struct { long a; }",
                                      "struct { unsigned long a; }",
                                      "struct { size_t a; }",
                                      "struct { double a[1073741824]; }",
                                      "struct { int8_t a[0]; }",
                                      "struct { int8_t a[-1]; }",
                                      "struct { int8_t a[4294967297]; }",
                                      "struct { int8_t a; } b",
                                      "int8_t x",
                                      "struct { struct { struct { struct { struct { struct { struct { struct { "
                                      "struct { struct { int8_t a; } a; } a; } a; } a; } a; } a; } a; } a; } a; }"};
    static const char *const extents[] = {"x=3", "a", "a=", "a=0", "a=11", "a=-1", "=3"};
    struct form *form;
    for (size_t i = 0; i < sizeof(bad) / sizeof(*bad); i++)
        CHECK_EQUAL(form_of_text("T", bad[i], "", &form), -EINVAL);
    for (size_t i = 0; i < sizeof(extents) / sizeof(*extents); i++)
        CHECK_EQUAL(form_of_text("T", "struct { char a[10]; }", extents[i], &form), -EINVAL);
    /* Legal, but has too many leaves. */
    CHECK_EQUAL(form_of_text("T", "struct { struct { int8_t a; int8_t b; } s[100000]; }", "", &form), -E2BIG);
}

/* Measuring a form says what making it gives. */
static void test_it_is_measured(void) {
    static const char *const texts[][2] = {
        {"struct { int8_t a; struct { float b; double c[3]; } d[12]; int16_t e; }", ""},
        {"struct { char y[100]; char u[25]; int32_t n; }", "y=8 u=0"},
        {"struct { struct { struct { int8_t a; int64_t b; } c[7]; int8_t d; } e[9]; uint8_t f; }", ""},
        {"int16_t", ""}};
    struct form_measures measures;
    struct form *form;

    for (size_t i = 0; i < sizeof(texts) / sizeof(*texts); i++) {
        CHECK_EQUAL(form_of_text("T", texts[i][0], texts[i][1], &form), 0);
        CHECK_EQUAL(form_measure(texts[i][0], texts[i][1], &measures), 0);
        CHECK_EQUAL(measures.message_size, form->message_size);
        CHECK_EQUAL(measures.leaves, form->leaf_count);
        size_t bytes = form->leaf_count * sizeof *form->leaves;
        for (unsigned k = 0; k < form->leaf_count; k++)
            bytes += strlen(form->leaves[k].name);
        CHECK(measures.bytes >= bytes);
        form_free(form);
    }
    CHECK_EQUAL(form_measure("struct { struct { int8_t a; int8_t b; } s[100000]; }", "", &measures), -E2BIG);
    CHECK_EQUAL(form_measure("struct { double a[1073741824]; }", "", &measures), -EINVAL);
    CHECK_EQUAL(form_measure("struct { char a; }", "a=0", &measures), -EINVAL);
}

int main(void) {
    test_it_is_measured();
    test_places();
    test_extents();
    test_a_field_without_bytes();
    test_names_that_meet();
    test_it_is_read_again();
    test_what_is_no_declaration();
    return 0;
}
