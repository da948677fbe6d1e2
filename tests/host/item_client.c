/* SPDX-License-Identifier: GPL-2.0-or-later */
/* item_client TEST: valid and invalid video items, written and viewed in one process. Exit status 0: passed. */
#define DDXVIDEO_UNDECLARED
#include <ddxvideo.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define CHECK(condition)                                                                              \
    do {                                                                                              \
        if (!(condition)) {                                                                           \
            fprintf(stderr, "%s:%d: failed: %s (errno %d)\n", __FILE__, __LINE__, #condition, errno); \
            exit(1);                                                                                  \
        }                                                                                             \
    } while (0)

static DDX_STORE_ID *id;

static void fill(struct ddxvideo_frame *frame, int value) {
    for (int i = 0; i < 3; i++)
        memset(frame->plane[i], value + i, (size_t)frame->stride[i] * (size_t)frame->rows[i]);
}

/* Reads every byte of a view. */
static void check_planes(const struct ddxvideo_picture *view, int value) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < view->stride[i] * view->rows[i]; j++)
            CHECK(view->plane[i][j] == (unsigned char)(value + i));
}

static void good(int width, int height) {
    struct ddxvideo_geometry geometry = {.width = width,
                                         .height = height,
                                         .fields = 1,
                                         .rate_num = 30000,
                                         .rate_den = 1001,
                                         .aspect_num = 12,
                                         .aspect_den = 11,
                                         .format = DDX_VIDEO_420_MPEG2,
                                         .interlacing = 't',
                                         .range = 2};
    DDX_STORE_ITEM *writer, *reader, *counter;
    struct ddxvideo_frame frame;
    struct ddx_frame held;
    struct ddxvideo_picture view;
    CHECK(!ddxvideo_create(id, "video", &geometry, &writer));
    CHECK(!ddxvideo_counter_create(id, "video", &counter));
    CHECK((reader = ddx_store_lookup_item(id, "video", NULL, 0)));
    for (int i = 0; i < 3; i++) {
        CHECK(!ddxvideo_loan(writer, &geometry, &frame));
        fill(&frame, 10 * i);
        frame.stamp = (struct ddxvideo_stamp){
            .frame = i, .time = INT64_C(1) << 62, .wall_offset = -5, .source_sequence = 7, .source_lost = 8};
        CHECK(!ddxvideo_publish(writer, &frame));
        CHECK(!ddxvideo_counter_write(counter, i));
        CHECK(!(errno = -ddx_store_acquire(reader, &held, 1, DDX_CURRENT)));
        CHECK(!ddxvideo_view(reader, held.data, &view));
        CHECK(!memcmp(&view.geometry, &geometry, sizeof(geometry)));
        CHECK(view.stamp.frame == i && view.stamp.time == INT64_C(1) << 62 && view.stamp.wall_offset == -5);
        CHECK(view.stamp.source_sequence == 7 && view.stamp.source_lost == 8);
        check_planes(&view, 10 * i);
        CHECK(!ddx_store_release(reader));
    }
    /* A smaller picture fits, a larger one does not. */
    geometry.width += 2;
    CHECK(ddxvideo_loan(writer, &geometry, &frame) == -EMSGSIZE);
    geometry.width -= 4;
    CHECK(!ddxvideo_loan(writer, &geometry, &frame));
    CHECK(!ddx_store_cancel(writer));
    geometry.width += 1;
    CHECK(ddxvideo_loan(writer, &geometry, &frame) == -EINVAL);
}

#define FIELD(name) offsetof(struct ddxvideo_geometry, name)
static const size_t fields[] = {FIELD(fields),      FIELD(width),      FIELD(height),     FIELD(rate_num),
                                FIELD(rate_den),    FIELD(aspect_num), FIELD(aspect_den), FIELD(format),
                                FIELD(interlacing), FIELD(range)};
static const int values[] = {0, -1, 1, 2, 63, 64, 66, 8192, 65536, INT32_MAX, INT32_MIN};

static void set(struct ddxvideo_geometry *geometry, size_t field, int value) {
    memcpy((char *)geometry + field, &value, sizeof(value));
}

/* A writer with false geometry: a view is refused or lies within the planes. */
static void hostile(void) {
    struct ddxvideo_geometry geometry = {.width = 64, .height = 48, .fields = 1};
    const size_t count = sizeof(values) / sizeof(*values);
    DDX_STORE_ITEM *writer, *reader;
    struct ddx_frame held;
    int refused = 0;
    CHECK(!ddxvideo_create(id, "video", &geometry, &writer));
    CHECK((reader = ddx_store_lookup_item(id, "video", NULL, 0)));
    for (size_t f = 0; f < sizeof(fields) / sizeof(*fields); f++) {
        for (size_t v = 0; v < count * count; v++) {
            struct ddxvideo_frame frame;
            struct ddxvideo_picture view;
            CHECK(!ddxvideo_loan(writer, &geometry, &frame));
            fill(&frame, 5);
            set(&frame.geometry, fields[f], values[v / count]);
            set(&frame.geometry, fields[(f + 1) % 10], values[v % count]);
            CHECK(!ddxvideo_publish(writer, &frame));
            CHECK(!(errno = -ddx_store_acquire(reader, &held, 1, DDX_CURRENT)));
            int error = ddxvideo_view(reader, held.data, &view);
            CHECK(!error || error == -EBADMSG);
            refused += error != 0;
            unsigned sum = 0;
            for (int i = 0; !error && i < 3; i++)
                for (int j = 0; j < view.stride[i] * view.rows[i]; j++)
                    sum += view.plane[i][j];
            CHECK(error || view.geometry.width * view.geometry.height <= 64 * 48);
            CHECK(error || view.geometry.rate_num <= DDX_VIDEO_RATE * (int64_t)view.geometry.rate_den);
            CHECK(sum < 1 << 30);
            CHECK(!ddx_store_release(reader));
        }
    }
    CHECK(refused > 500 && refused < 1210);
}

/* Each layout has its planes and no others; a viewer that does not request it sees no frame. */
static void layouts(void) {
    static const struct {
        int format, bytes[3];
    } table[] = {
        {DDX_VIDEO_420_JPEG, {80 * 60, 40 * 30, 40 * 30}},
        {DDX_VIDEO_YUV422P, {80 * 60, 40 * 60, 40 * 60}},
        {DDX_VIDEO_YUV444P, {80 * 60, 80 * 60, 80 * 60}},
        {DDX_VIDEO_GREY8, {80 * 60, 0, 0}},
        {DDX_VIDEO_GREY16, {160 * 60, 0, 0}},
        {DDX_VIDEO_RGB24, {240 * 60, 0, 0}},
    };
    for (size_t i = 0; i < sizeof(table) / sizeof(*table); i++) {
        struct ddxvideo_geometry geometry = {.width = 80, .height = 60, .fields = 1, .format = table[i].format};
        char name[] = {'l', (char)('0' + i), 0};
        DDX_STORE_ITEM *writer, *reader;
        struct ddxvideo_frame frame;
        struct ddxvideo_picture view;
        struct ddx_frame held;
        CHECK(!ddxvideo_create(id, name, &geometry, &writer));
        CHECK(!ddxvideo_loan(writer, &geometry, &frame));
        fill(&frame, 7);
        CHECK(!ddxvideo_publish(writer, &frame));
        CHECK((reader = ddx_store_lookup_item(id, name, NULL, 0)));
        CHECK(!ddx_store_acquire(reader, &held, 1, DDX_CURRENT));
        CHECK(!ddxvideo_view_any(reader, held.data, &view));
        CHECK(view.geometry.format == table[i].format);
        for (int plane = 0; plane < 3; plane++) {
            CHECK(view.stride[plane] * view.rows[plane] == table[i].bytes[plane]);
            CHECK(!view.plane[plane] == !table[i].bytes[plane] && !frame.plane[plane] == !view.plane[plane]);
        }
        check_planes(&view, 7);
        CHECK(ddxvideo_view(reader, held.data, &view) == (table[i].format < 16 ? 0 : -EPROTOTYPE));
        CHECK(!ddx_store_release(reader));
        /* Samples have one C type. */
        geometry.format = table[i].format == DDX_VIDEO_GREY16 ? DDX_VIDEO_GREY8 : DDX_VIDEO_GREY16;
        geometry.height = 2;
        CHECK(ddxvideo_loan(writer, &geometry, &frame) == -EPROTOTYPE);
    }
}

static void lie(DDX_STORE_ITEM *writer, DDX_STORE_ITEM *reader, struct ddxvideo_geometry geometry, int format) {
    struct ddxvideo_frame frame;
    struct ddxvideo_picture view;
    struct ddx_frame held;
    unsigned sum = 0;
    CHECK(!ddxvideo_loan(writer, &geometry, &frame));
    fill(&frame, 5);
    frame.geometry.format = format;
    CHECK(!ddxvideo_publish(writer, &frame));
    CHECK(!ddx_store_acquire(reader, &held, 1, DDX_CURRENT));
    int error = ddxvideo_view_any(reader, held.data, &view);
    CHECK(!error || error == -EBADMSG);
    for (int i = 0; !error && i < 3; i++)
        for (int k = 0; k < view.stride[i] * view.rows[i]; k++)
            sum += view.plane[i][k];
    CHECK(sum < 1 << 30 && (!error || ddxvideo_view(reader, held.data, &view)));
    CHECK(!ddx_store_release(reader));
}

/* A frame with any format number, in any item: a view lies within the item's planes. */
static void false_formats(void) {
    for (int real = 15; real <= 20; real++) {
        struct ddxvideo_geometry geometry = {.width = 64, .height = 48, .fields = 1, .format = real < 16 ? 0 : real};
        char name[] = {'f', (char)('a' + real), 0};
        DDX_STORE_ITEM *writer, *reader;
        CHECK(!ddxvideo_create(id, name, &geometry, &writer));
        CHECK((reader = ddx_store_lookup_item(id, name, NULL, 0)));
        for (int format = -1; format < 23; format++)
            lie(writer, reader, geometry, format);
    }
}

/* Only the paper's seven fields, with its own size limit. */
static struct {
    int frame, fields, width, height;
    char y[4800], u[1200], v[1200];
} paper_video = {.fields = 1, .width = 80, .height = 60};

static DDX_STORE_ITEM *create_paper_video(void) {
    const struct ddx_item_spec spec = {.name = "video",
                                       .type = "DDX_VIDEO",
                                       .declaration = "struct { int frame; int fields; int width; int height;"
                                                      " char y[4800]; char u[1200]; char v[1200]; }",
                                       .size = sizeof(paper_video)};
    DDX_STORE_ITEM *writer;
    CHECK(!ddx_store_create(id, &spec, &writer));
    return writer;
}

static void write_paper_video(DDX_STORE_ITEM *writer, int number) {
    paper_video.frame = number;
    memset(paper_video.y, number, sizeof(paper_video.y));
    memset(paper_video.u, number + 1, sizeof(paper_video.u));
    memset(paper_video.v, number + 2, sizeof(paper_video.v));
    CHECK(!ddx_store_write(writer, &paper_video, NULL));
}

static void paper_writer(void) {
    DDX_STORE_ITEM *writer = create_paper_video(), *reader;
    struct ddx_frame held;
    struct ddxvideo_picture view;
    write_paper_video(writer, 9);
    CHECK((reader = ddx_store_lookup_item(id, "video", NULL, 0)));
    CHECK(!ddx_store_acquire(reader, &held, 1, DDX_CURRENT));
    CHECK(!ddxvideo_view(reader, held.data, &view));
    CHECK(view.stamp.frame == 9 && view.geometry.width == 80 && view.stamp.time == 0 && view.geometry.rate_num == 0);
    check_planes(&view, 9);
}

/* A grabber with such an item: 20 frames, once there is a reader. */
static void paper_grabber(void) {
    DDX_STORE_ITEM *writer = create_paper_video();
    while (ddx_store_readers(writer) < 1)
        usleep(1000);
    for (int i = 0; i < 20; i++) {
        write_paper_video(writer, i);
        usleep(10000);
    }
}

/* 20 frames; a quarter of them claim to be larger than they are. */
static void broken_grabber(void) {
    const struct ddxvideo_geometry geometry = {.width = 64, .height = 48, .fields = 1};
    DDX_STORE_ITEM *writer;
    struct ddxvideo_frame frame;
    CHECK(!ddxvideo_create(id, "video", &geometry, &writer));
    while (ddx_store_readers(writer) < 1)
        usleep(1000);
    for (int i = 0; i < 20; i++) {
        CHECK(!ddxvideo_loan(writer, &geometry, &frame));
        fill(&frame, i);
        frame.stamp.frame = i;
        frame.stamp.time = ddx_time_now();
        if (i % 4 == 1)
            frame.geometry.width = 8192;
        CHECK(!ddxvideo_publish(writer, &frame));
        usleep(10000);
    }
}

static void no_video(void) {
    const struct ddx_item_spec spec = {
        .name = "other", .type = "other", .declaration = "struct { int width; float y; }"};
    DDX_STORE_ITEM *writer;
    struct ddxvideo_picture view;
    void *data;
    CHECK(!ddx_store_create(id, &spec, &writer));
    CHECK(!ddx_store_loan(writer, &data));
    CHECK(ddxvideo_view(writer, data, &view) == -EPROTOTYPE);
}

static void parameters(void) {
    static DDX_VIDEO_PARAMETERS set = {
        .count = 2,
        .parameter = {{"brightness", 5, 0, 255, 1, 128, 0}, {"gain", 1, 0, 3, 1, 0, DDX_VIDEO_PARAMETER_AUTOMATIC}}};
    static DDX_VIDEO_PARAMETERS got;
    DDX_STORE_ITEM *writer, *reader;
    CHECK(!ddxvideo_parameters_create(id, "video", &writer));
    CHECK(!ddxvideo_parameters_write(writer, &set));
    CHECK((reader = ddx_store_lookup_item(id, "video.parameters", NULL, 0)));
    CHECK(!ddx_store_read(reader, &got, NULL, 1, DDX_CURRENT));
    CHECK(!memcmp(&set, &got, sizeof(set)));
    set.count = DDX_VIDEO_PARAMETERS_MAX + 1;
    CHECK(ddxvideo_parameters_write(writer, &set) == -EINVAL);
    set.count = 1;
    memset(set.parameter[0].name, 'x', sizeof(set.parameter[0].name));
    CHECK(ddxvideo_parameters_write(writer, &set) == -EINVAL);
}

int main(int argc, char **argv) {
    const char *test = argc > 1 ? argv[1] : "";
    CHECK((id = ddx_store_open(NULL, 0, 5)));
    if (!strcmp(test, "cif"))
        good(352, 288);
    else if (!strcmp(test, "4k"))
        good(3840, 2160);
    else if (!strcmp(test, "hostile"))
        hostile();
    else if (!strcmp(test, "layouts"))
        layouts();
    else if (!strcmp(test, "false_formats"))
        false_formats();
    else if (!strcmp(test, "paper_writer"))
        paper_writer();
    else if (!strcmp(test, "paper_grabber"))
        paper_grabber();
    else if (!strcmp(test, "broken_grabber"))
        broken_grabber();
    else if (!strcmp(test, "no_video"))
        no_video();
    else if (!strcmp(test, "parameters"))
        parameters();
    else
        return 2;
    ddx_store_close(id);
    return 0;
}
