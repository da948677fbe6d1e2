/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * ddxvideo: what a video item in the store looks like, and how to read and write one.
 *
 * A video item has the type DDX_VIDEO. Its first seven fields are those of the DDX papers; a program that knows
 * only these reads every item of this kind. The fields after them are ours: times, and the contents of a
 * Y4M header.
 *
 * A reader that wants every size of picture, without a copy:
 *
 *     DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5.0);
 *     DDX_STORE_ITEM *item = ddx_store_lookup_item(id, "video", NULL, 0);
 *     struct ddx_frame frame;
 *     struct ddxvideo_picture view;
 *     while (!ddx_store_acquire(item, &frame, 1.0, DDX_NEXT)) {
 *         if (!ddxvideo_view(item, frame.data, &view))
 *             look_at(view.plane[0], view.stride[0], view.geometry.width, view.geometry.height);
 *         ddx_store_release(item);                  // view.plane is invalid from here on
 *     }
 *
 * A writer:
 *
 *     struct ddxvideo_geometry geometry = {.width = 352, .height = 288, .fields = 1, .rate_num = 25, .rate_den = 1};
 *     struct ddxvideo_frame frame;
 *     int error = ddxvideo_create(id, "video", &geometry, &item);
 *     for (int i = 0; !error && !ddxvideo_loan(item, &geometry, &frame); i++) {
 *         draw(frame.plane, frame.stride);
 *         frame.stamp = (struct ddxvideo_stamp){.frame = i, .time = ddx_time_now(),
 *                                               .wall_offset = ddxvideo_wall_offset()};
 *         error = ddxvideo_publish(item, &frame);   // or ddx_store_cancel(item)
 *     }
 *
 * Common rules
 *   errors     0 or -errno, those of ddx.h and: -EINVAL an impossible geometry (see ddxvideo_geometry_error),
 *              -EBADMSG an item whose numbers do not fit its memory, -EPROTOTYPE an item that is not a video, or whose
 *              layout is not 4:2:0 where a function supports only that.
 *   ownership  items are the caller's as in ddx.h; structs are filled by value; plane pointers belong to the store and
 *              are valid while the frame is held or loaned.
 *   blocking   functions that create an item wait as ddx_store_create() does; no other function waits.
 *   layouts    pictures are 8-bit 4:2:0 unless the item has another format (enum ddx_video_format). Items of other
 *              layouts have samples of another C type: a program that supports only 4:2:0 cannot open them, or its
 *              ddxvideo_view() fails, so it never mistakes one layout for another.
 *   time       ns; `time` is CLOCK_MONOTONIC of the capture, time + wall_offset is CLOCK_REALTIME. (ddx_frame.time is
 *              the time of the write.) A value computed from a picture takes the picture's capture time, so that a log
 *              and a recording agree: ddx_store_write(item, &value, &view.stamp.time).
 */
#ifndef DDXVIDEO_H
#define DDXVIDEO_H

#include <ddx.h>

#ifdef __cplusplus
extern "C" {
#endif

#define DDX_VIDEO_MAX 2073600 /* luma samples in DDX_VIDEO: 1920 * 1080. Items of larger pictures have larger bounds */
#define DDX_VIDEO_SIDE 8192   /* largest width, and largest height */
#define DDX_VIDEO_FIELDS 16   /* maximum number of fields stacked in one frame */
#define DDX_VIDEO_RATE 10000  /* largest frame rate, frames per second; a larger one counts as unknown */

/*
 * Planes without padding; in 4:2:0, y has width * height bytes, u and v a quarter of that. Several synchronised fields
 * (a stereo pair, say) are stacked: `height` counts the rows of all of them, each has height / fields rows.
 */
#define DDX_VIDEO_STRUCT_(SAMPLE, MAX, CHROMA)                                                    \
    struct {                                                                                      \
        int frame;  /* number of the frame, from 0, in the source's count */                      \
        int fields; /* stacked in this frame, at least 1 */                                       \
        int width;                                                                                \
        int height;                                                                               \
        SAMPLE y[MAX];                                                                            \
        SAMPLE u[CHROMA];                                                                         \
        SAMPLE v[CHROMA];                                                                         \
        int64_t time;            /* of the capture, ns */                                         \
        int64_t wall_offset;     /* CLOCK_REALTIME - CLOCK_MONOTONIC at the capture, ns */        \
        int64_t source_sequence; /* the source's own number of this frame (a driver's counter) */ \
        int64_t source_lost;     /* frames that the source itself has lost so far */              \
        int rate_num;            /* frames per second, 0/0 if unknown */                          \
        int rate_den;                                                                             \
        int aspect_num; /* of a pixel, 0/0 if unknown */                                          \
        int aspect_den;                                                                           \
        int format;      /* enum ddx_video_format */                                              \
        int interlacing; /* the letter of Y4M's I: '?' 'p' 't' 'b' 'm'; 0 is '?' */               \
        int range;       /* enum ddx_video_range */                                               \
        int reserved[5]; /* 0 */                                                                  \
    }

/*
 * A program that declares the type to the store can use ddx_store_read(), and then opens only items that have all these
 * fields. One that uses ddxvideo_view() alone defines DDXVIDEO_UNDECLARED before including this header, and opens items
 * with the paper's seven fields as well.
 */
#ifdef DDXVIDEO_UNDECLARED
typedef DDX_VIDEO_STRUCT_(char, DDX_VIDEO_MAX, DDX_VIDEO_MAX / 4) DDX_VIDEO;
#else
DDX_STORE_TYPE(DDX_VIDEO, DDX_VIDEO_STRUCT_(char, DDX_VIDEO_MAX, DDX_VIDEO_MAX / 4));
#endif

/*
 * Layout of the planes, and where the chroma samples sit. Numbers from 16 are for layouts other than 8-bit 4:2:0.
 * Their samples are `unsigned char` in the item, those of GREY16 `unsigned short`. Grey and RGB pictures are in plane y
 * alone; u and v are unused. 4:2:0 needs an even width and height, 4:2:2 an even width.
 */
enum ddx_video_format {
    DDX_VIDEO_420 = 0,       /* 4:2:0, siting unknown */
    DDX_VIDEO_420_JPEG = 1,  /* in the middle of four luma samples */
    DDX_VIDEO_420_MPEG2 = 2, /* on the left luma column */
    DDX_VIDEO_420_PALDV = 3, /* as DV, u and v on alternate rows */
    DDX_VIDEO_YUV422P = 16,  /* 4:2:2, chroma on the left luma column */
    DDX_VIDEO_YUV444P = 17,
    DDX_VIDEO_GREY8 = 18,
    DDX_VIDEO_GREY16 = 19, /* 16 bits a pixel, little endian; a range has its 8-bit limits times 256 */
    DDX_VIDEO_RGB24 = 20   /* red, green, blue: 3 bytes a pixel */
};

enum ddx_video_range { DDX_VIDEO_RANGE_UNKNOWN = 0, DDX_VIDEO_RANGE_LIMITED = 1, DDX_VIDEO_RANGE_FULL = 2 };

/* "YUV420P" (for all four 4:2:0 formats), "YUV422P", "GREY8" ...; NULL for an unknown format. */
const char *ddxvideo_layout_name(int format);

/* Properties that stay the same from frame to frame. */
struct ddxvideo_geometry {
    int width, height, fields;
    int rate_num, rate_den;
    int aspect_num, aspect_den;
    int format, interlacing, range;
};

/* Properties of each frame. */
struct ddxvideo_stamp {
    int frame;
    int64_t time, wall_offset, source_sequence, source_lost;
};

/* NULL if the geometry is possible; otherwise the reason, as a static text. */
const char *ddxvideo_geometry_error(const struct ddxvideo_geometry *geometry);

/*
 * 1 if this frame rate is known and possible: above 0, at most DDX_VIDEO_RATE. Otherwise 0. A program that sizes memory
 * or a clock by a rate from a file, a network or another program checks the rate with this first.
 */
int ddxvideo_rate_known(int rate_num, int rate_den);

/* Whether two geometries have the same planes with the same meaning; rate and aspect may differ. */
int ddxvideo_same_layout(const struct ddxvideo_geometry *a, const struct ddxvideo_geometry *b);

/*
 * Create the item, or take it over from a writer that has exited (also with another geometry), and become its writer.
 * It takes memory for the planes of this geometry, not for DDX_VIDEO_MAX. Errors: -EINVAL, and those of
 * ddx_store_create().
 */
int ddxvideo_create(DDX_STORE_ID *id, const char *name, const struct ddxvideo_geometry *geometry,
                    DDX_STORE_ITEM **item);

/* A frame to be filled. */
struct ddxvideo_frame {
    struct ddxvideo_stamp stamp; /* the caller's; all 0 after ddxvideo_loan() */
    struct ddxvideo_geometry geometry;
    unsigned char *plane[3]; /* y, u, v; their content is undefined at first; NULL: the layout has no such plane */
    int stride[3];           /* bytes from row to row; 0 without a plane */
    int rows[3];
    void *data; /* the loaned frame, as of ddx_store_loan() */
};

/*
 * A free frame to draw in. The geometry may differ from the one the item was created with, as long as its planes
 * are not larger and their samples have the same C type. Finish it with ddxvideo_publish() or ddx_store_cancel(). On
 * failure nothing is loaned. Errors: -EINVAL, -EMSGSIZE (larger planes), -EPROTOTYPE (other samples), and those of
 * ddx_store_loan().
 */
int ddxvideo_loan(DDX_STORE_ITEM *item, const struct ddxvideo_geometry *geometry, struct ddxvideo_frame *frame);

/* Write geometry and stamp beside the planes and publish the frame; the time of the write is now. */
int ddxvideo_publish(DDX_STORE_ITEM *item, const struct ddxvideo_frame *frame);

/* A frame to be read. */
struct ddxvideo_picture {
    struct ddxvideo_stamp stamp;
    struct ddxvideo_geometry geometry;
    const unsigned char *plane[3]; /* NULL: the layout has no such plane */
    int stride[3];
    int rows[3];
};

/*
 * Read the frame `data`, which ddx_store_acquire() or ddx_store_read_direct() returned. Works with any bounds of the
 * arrays, and for items that have the paper's seven fields only (the rest is 0 then). The item is not trusted: each
 * number is read once and checked, and the planes lie within the item's memory. A frame rate above DDX_VIDEO_RATE
 * becomes 0/0, unknown. On failure *view is undefined.
 * Errors: -EPROTOTYPE (also for pictures that are not 8-bit 4:2:0), -EBADMSG.
 */
int ddxvideo_view(const DDX_STORE_ITEM *item, const void *data, struct ddxvideo_picture *view);

/* The same for pictures of every layout: the caller checks view->geometry.format before it reads the planes. */
int ddxvideo_view_any(const DDX_STORE_ITEM *item, const void *data, struct ddxvideo_picture *view);

/* CLOCK_REALTIME - CLOCK_MONOTONIC now, ns. */
int64_t ddxvideo_wall_offset(void);

/* ---- Frame counter: item `<name>.frame` of type "int", the number of the newest frame ---- */

/* Errors: -EINVAL (name too long), and those of ddx_store_create(). */
int ddxvideo_counter_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item);

/* After each ddxvideo_publish(). */
int ddxvideo_counter_write(DDX_STORE_ITEM *item, int frame);

/*
 * ---- Parameters of the source: item `<name>.parameters`, written whenever a setting changes ----
 *
 * Those of a camera can be changed by a request: ddx_request(id, "video", ...), see ddx_request.h, or `ddxctl set video
 * brightness=128`. A menu's value is the number of its entry; a button is pressed by 1.
 */

#define DDX_VIDEO_PARAMETERS_MAX 128

DDX_STORE_TYPE(
    DDX_VIDEO_PARAMETERS, struct {
        int count;
        struct {
            char name[32]; /* ends with a 0 byte */
            int value;
            int minimum;
            int maximum;
            int step;
            int initial;
            int flags; /* enum ddx_video_parameter_flags */
        } parameter[DDX_VIDEO_PARAMETERS_MAX];
    });

enum ddx_video_parameter_flags {
    DDX_VIDEO_PARAMETER_READ_ONLY = 1,
    DDX_VIDEO_PARAMETER_AUTOMATIC = 2 /* the source currently sets it automatically */
};

/* Errors: -EINVAL (name too long), and those of ddx_store_create(). */
int ddxvideo_parameters_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item);

/* -EINVAL: a bad count, or a name without a terminating zero. */
int ddxvideo_parameters_write(DDX_STORE_ITEM *item, const DDX_VIDEO_PARAMETERS *parameters);

/*
 * ---- Range: item `<name>.stereo` beside a range picture `<name>` and its disparities `<name>.disparity` ----
 *
 * The disparities are GREY16 pictures: for each pixel of the left rectified picture, in 1/16 pixel; 0 is unknown. With
 * d in pixels, a point is f * T / d away along the axis of the left camera, (x - cx) * T / d to its right and
 * (y - cy) * T / d below it, in the unit of T, which is that of the calibration: metres, if the squares of the
 * chessboard were given in metres.
 */
DDX_STORE_TYPE(
    DDX_VIDEO_STEREO, struct {
        double f;        /* focal length, pixels */
        double T;        /* distance between the cameras */
        double cx, cy;   /* centre of the rectified pictures, pixels */
        double min, max; /* range of the disparities, pixels */
        double step;     /* a difference of 1 in the disparities, pixels */
    });

/* Errors: -EINVAL (name too long), and those of ddx_store_create(). */
int ddxvideo_stereo_create(DDX_STORE_ID *id, const char *video_name, DDX_STORE_ITEM **item);

#ifdef __cplusplus
}
#endif
#endif
