/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Parses and writes header and FRAME lines of Y4M. The input is not trusted. */
#include <inttypes.h>
#include <stdarg.h>
#include <string.h>

#include "video_layout.h"
#include "y4m.h"

/* The chroma layouts that Y4M knows, and how large their planes are. */

#define J DDX_VIDEO_420_JPEG
#define M DDX_VIDEO_420_MPEG2
#define NO (-1)

/* 4:2:0 made from another layout has the siting of its source, if that has one: chroma on the left luma column;
 * otherwise in the middle. */
static const struct y4m_layout layouts[] = {
    {"420jpeg", J, J, 8, 1, 1, false},
    {"420mpeg2", M, M, 8, 1, 1, false},
    {"420paldv", DDX_VIDEO_420_PALDV, DDX_VIDEO_420_PALDV, 8, 1, 1, false},
    {"420", DDX_VIDEO_420, DDX_VIDEO_420, 8, 1, 1, false},
    {"411", M, NO, 8, 2, 0, false},
    {"410", J, NO, 8, 2, 2, false},
    {"422", M, DDX_VIDEO_YUV422P, 8, 1, 0, false},
    {"444", M, DDX_VIDEO_YUV444P, 8, 0, 0, false},
    {"444alpha", M, NO, 8, 0, 0, true},
    {"mono", J, DDX_VIDEO_GREY8, 8, -1, -1, false},
    {"420p9", M, NO, 9, 1, 1, false},
    {"420p10", M, NO, 10, 1, 1, false},
    {"420p12", M, NO, 12, 1, 1, false},
    {"420p14", M, NO, 14, 1, 1, false},
    {"420p16", M, NO, 16, 1, 1, false},
    {"422p9", M, NO, 9, 1, 0, false},
    {"422p10", M, NO, 10, 1, 0, false},
    {"422p12", M, NO, 12, 1, 0, false},
    {"422p14", M, NO, 14, 1, 0, false},
    {"422p16", M, NO, 16, 1, 0, false},
    {"444p9", M, NO, 9, 0, 0, false},
    {"444p10", M, NO, 10, 0, 0, false},
    {"444p12", M, NO, 12, 0, 0, false},
    {"444p14", M, NO, 14, 0, 0, false},
    {"444p16", M, NO, 16, 0, 0, false},
    {"mono9", J, NO, 9, -1, -1, false},
    {"mono10", J, NO, 10, -1, -1, false},
    {"mono12", J, NO, 12, -1, -1, false},
    {"mono14", J, NO, 14, -1, -1, false},
    {"mono16", J, DDX_VIDEO_GREY16, 16, -1, -1, false},
};

/* The layout of this C tag, or NULL. */
static const struct y4m_layout *y4m_layout_named(const char *tag) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (!strcmp(layouts[i].tag, tag))
            return &layouts[i];
    return NULL;
}

/* The C tag of an enum ddx_video_format; NULL: no file can have such pictures. */
static const char *y4m_layout_tag(int format) {
    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++)
        if (layouts[i].same == format)
            return layouts[i].tag;
    return NULL;
}

bool y4m_has(int format) {
    return y4m_layout_tag(format);
}

bool y4m_is_plain(const struct y4m_header *header) {
    return header->layout->same == header->geometry.format;
}

size_t y4m_plane_bytes(const struct y4m_header *header, int plane) {
    const struct y4m_layout *layout = header->layout;
    size_t width = (size_t)header->geometry.width, height = (size_t)header->geometry.height;
    size_t sample = layout->bits > 8 ? 2 : 1;

    if (plane == 1 || plane == 2) {
        if (layout->chroma_x < 0)
            return 0;
        width = (width + (1u << layout->chroma_x) - 1) >> layout->chroma_x;
        height = (height + (1u << layout->chroma_y) - 1) >> layout->chroma_y;
    } else if (plane == 3 && !layout->alpha) {
        return 0;
    }
    return width * height * sample;
}

#define MAGIC Y4M_MAGIC

__attribute__((format(printf, 2, 3))) static bool fail(char *error, const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(error, Y4M_ERROR_MAX, format, arguments);
    va_end(arguments);
    for (char *c = error; *c; c++) /* the input may have any bytes; a message is one line of text */
        if ((unsigned char)*c < 0x20 || (unsigned char)*c > 0x7e)
            *c = '?';
    return false;
}

/* Decimal digits up to `end` (a character or 0), no sign, no more than `maximum`. */
static bool number(const char **text, char end, int64_t maximum, int64_t *value) {
    int64_t result = 0;
    const char *c = *text;

    for (; *c >= '0' && *c <= '9'; c++) {
        if (result > (maximum - (*c - '0')) / 10)
            return false;
        result = result * 10 + (*c - '0');
    }
    if (c == *text || *c != end)
        return false;
    *text = end ? c + 1 : c;
    *value = result;
    return true;
}

static bool single(const char *text, int64_t maximum, int64_t *value) {
    return number(&text, 0, maximum, value);
}

/* "num:den", both zero ("unknown") or neither. */
static bool ratio(const char *text, int *num, int *den) {
    int64_t a, b;

    if (!number(&text, ':', INT32_MAX, &a) || !number(&text, 0, INT32_MAX, &b) || !a != !b)
        return false;
    *num = (int)a;
    *den = (int)b;
    return true;
}

/* The value of "NAME=value" if it has this name. */
static const char *named(const char *word, const char *name) {
    size_t length = strlen(name);

    return strncmp(word, name, length) || word[length] != '=' ? NULL : word + length + 1;
}

/* The next word of a line, cut out; NULL at the end. Words are separated by one or more spaces. */
static char *next_word(char **rest) {
    char *word = *rest + strspn(*rest, " ");

    if (!*word)
        return NULL;
    char *end = word + strcspn(word, " ");
    *rest = *end ? end + 1 : end;
    *end = 0;
    return word;
}

static bool side(const char *text, const char *what, int *value, char *error) {
    int64_t result;

    if (!single(text, INT32_MAX, &result))
        return fail(error, "bad header: %s '%.20s' is no size; the file is damaged, or no Y4M", what, text);
    if (result > DDX_VIDEO_SIDE)
        return fail(error, "%s %" PRId64 " is too large (limit %dx%d); scale it down: ffmpeg -i FILE -vf scale=...",
                    what, result, DDX_VIDEO_SIDE, DDX_VIDEO_SIDE);
    *value = (int)result;
    return true;
}

static bool our_parameter(const char *word, struct y4m_header *header, char *error) {
    struct ddxvideo_geometry *geometry = &header->geometry;
    const char *value;
    int64_t result;

    if ((value = named(word, "XDDX_FIELDS"))) {
        if (!single(value, DDX_VIDEO_FIELDS, &result) || !result)
            return fail(error, "bad header: %.40s; from 1 to %d fields can be stacked", word, DDX_VIDEO_FIELDS);
        geometry->fields = (int)result;
    } else if ((value = named(word, "XCOLORRANGE"))) {
        if (!strcmp(value, "FULL"))
            geometry->range = DDX_VIDEO_RANGE_FULL;
        else if (!strcmp(value, "LIMITED"))
            geometry->range = DDX_VIDEO_RANGE_LIMITED;
    }
    return true; /* other X parameters belong to other programs */
}

static bool parameter(const char *word, struct y4m_header *header, char *error) {
    struct ddxvideo_geometry *geometry = &header->geometry;

    switch (*word) {
    case 'W': return side(word + 1, "width", &geometry->width, error);
    case 'H': return side(word + 1, "height", &geometry->height, error);
    case 'F':
        if (!ratio(word + 1, &geometry->rate_num, &geometry->rate_den))
            return fail(error, "bad header: '%.20s' is no frame rate; write it as F25:1", word);
        return true;
    case 'A':
        if (!ratio(word + 1, &geometry->aspect_num, &geometry->aspect_den))
            return fail(error, "bad header: '%.20s' is no pixel aspect; write it as A1:1", word);
        return true;
    case 'I':
        if (!word[1] || word[2] || !strchr("?ptbm", word[1]))
            return fail(error, "bad header: '%.20s' is no interlacing; use one of Ip It Ib Im I?", word);
        geometry->interlacing = word[1];
        return true;
    case 'C':
        header->layout = y4m_layout_named(word + 1);
        if (!header->layout)
            return fail(error, "unknown colourspace '%.20s'; convert it: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m",
                        word);
        return true;
    case 'X': return our_parameter(word, header, error);
    default: return true; /* unknown parameters have no effect here */
    }
}

/* The store's format for the file's pictures. */
static int choose_format(const struct y4m_layout *layout, int wanted) {
    if (wanted == Y4M_SAME)
        return layout->same >= 0 ? layout->same : layout->format;
    return video_layout_is_420(wanted) ? layout->format : wanted;
}

/* False if the wanted layout cannot have these sides. */
static bool check_sides(const struct ddxvideo_geometry *geometry, char *error) {
    const struct video_layout *layout = video_layout_of(geometry->format);
    int width = geometry->width, height = geometry->height;

    if (!width || !height)
        return fail(error, "bad header: width or height is missing or zero; the file is damaged");
    if (layout->chroma_y == 1 && (width % 2 || height % 2))
        return fail(error, "odd size %dx%d: 4:2:0 needs even sides; crop it: ffmpeg -i FILE -vf crop=%d:%d OUT.y4m",
                    width, height, width & ~1, height & ~1);
    if (layout->chroma_x == 1 && width % 2)
        return fail(error, "odd size %dx%d: 4:2:2 needs an even width; crop it: ffmpeg -i FILE -vf crop=%d:%d OUT.y4m",
                    width, height, width & ~1, height);
    return true;
}

bool y4m_parse_header(const char *line, int format, struct y4m_header *header, char *error) {
    char copy[Y4M_HEADER_MAX + 1];

    if (strncmp(line, MAGIC, sizeof MAGIC - 1) || (line[sizeof MAGIC - 1] && line[sizeof MAGIC - 1] != ' '))
        return fail(error, "no Y4M file: it does not begin with " MAGIC "; make one: ffmpeg -i FILE -pix_fmt yuv420p "
                           "OUT.y4m");
    if (strlen(line) >= sizeof copy)
        return fail(error, "bad header: longer than %d bytes; the file is damaged, or no Y4M", Y4M_HEADER_MAX);
    strcpy(copy, line);
    memset(header, 0, sizeof *header);
    header->geometry.fields = 1;
    header->layout = y4m_layout_named("420jpeg"); /* the default of Y4M */

    char *rest = copy + sizeof MAGIC - 1;
    for (char *word = next_word(&rest); word; word = next_word(&rest))
        if (!parameter(word, header, error))
            return false;

    struct ddxvideo_geometry *geometry = &header->geometry;
    geometry->format = choose_format(header->layout, format);
    if (!check_sides(geometry, error))
        return false;
    header->range = geometry->range;
    if (geometry->format == DDX_VIDEO_RGB24) /* has no other range */
        geometry->range = DDX_VIDEO_RANGE_FULL;
    if (!ddxvideo_rate_known(geometry->rate_num, geometry->rate_den))
        geometry->rate_num = geometry->rate_den = 0;
    const char *wrong = ddxvideo_geometry_error(geometry);
    return wrong ? fail(error, "bad header: %s; the file is damaged", wrong) : true;
}

int64_t y4m_parse_start(const char *line) {
    const char *word = strstr(line, " XDDX_START=");
    const char *text = word ? strchr(word, '=') + 1 : "";
    int64_t start;
    size_t length = strcspn(text, " ");
    char copy[24];

    if (!length || length >= sizeof copy)
        return -1;
    memcpy(copy, text, length);
    copy[length] = 0;
    return single(copy, INT64_MAX, &start) ? start : -1;
}

bool y4m_parse_frame(const char *line, int64_t *time, char *error) {
    char copy[Y4M_FRAME_LINE_MAX + 1];

    *time = -1;
    if (strncmp(line, "FRAME", 5) || (line[5] && line[5] != ' ') || strlen(line) >= sizeof copy)
        return fail(error, "no FRAME line where one should be; the file is damaged from there on");
    strcpy(copy, line);
    char *rest = copy + 5;
    for (char *word = next_word(&rest); word; word = next_word(&rest)) {
        const char *value = named(word, "XTIME");

        if (value && !single(value, Y4M_TIME_MAX, time))
            return fail(error, "%.40s is no time; the file is damaged", word);
    }
    return true;
}

size_t y4m_write_header(char line[Y4M_HEADER_WRITTEN], const struct ddxvideo_geometry *g) {
    /* Players need a frame rate. If it is not known, the times on the FRAME lines are right all the same. */
    bool known = ddxvideo_rate_known(g->rate_num, g->rate_den);
    const char *ranges[] = {"", " XCOLORRANGE=LIMITED", " XCOLORRANGE=FULL"};
    char main_part[Y4M_HEADER_WRITTEN], fields[24] = "";
    if (g->fields != 1)
        snprintf(fields, sizeof fields, " XDDX_FIELDS=%d", g->fields);
    int length = snprintf(main_part, sizeof main_part, MAGIC " W%d H%d F%d:%d I%c A%d:%d C%s%s", g->width, g->height,
                          known ? g->rate_num : 25, known ? g->rate_den : 1, g->interlacing ? g->interlacing : '?',
                          g->aspect_num, g->aspect_den, y4m_layout_tag(g->format), fields);
    /* Without the range if players would refuse the line. */
    const char *range = (size_t)length + strlen(ranges[g->range]) + 1 < Y4M_LINE_PLAYED ? ranges[g->range] : "";
    return (size_t)snprintf(line, Y4M_HEADER_WRITTEN, "%s%s\n", main_part, range);
}

size_t y4m_write_frame(char line[Y4M_FRAME_LINE_WRITTEN], int64_t time, int64_t start, int64_t wall) {
    char first[64] = "";
    int length = 0;

    if (start > 0)
        length = snprintf(first, sizeof first, " XDDX_START=%" PRId64, start);
    if (wall > 0)
        snprintf(first + length, sizeof first - (size_t)length, " XDDX_WALL=%" PRId64, wall);
    return (size_t)snprintf(line, Y4M_FRAME_LINE_WRITTEN, "FRAME XTIME=%" PRId64 "%s\n", time, first);
}
