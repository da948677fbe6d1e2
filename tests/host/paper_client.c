/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A client as in the paper: uses only libddx and the seven fields of a video. Prints frame number, size, and a sum over
 * the picture, once by copy and once in place.
 */
#include <ddx.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

#define MAX (720 * 576)

DDX_STORE_TYPE(
    DDX_VIDEO, struct {
        int frame;
        int fields;
        int width;
        int height;
        char y[MAX];
        char u[MAX / 4];
        char v[MAX / 4];
    });

static unsigned long sum(const char *plane, int size) {
    unsigned long result = 0;
    for (int i = 0; i < size; i++)
        result = result * 31 + (unsigned char)plane[i];
    return result & 0xffffffff;
}

static void print(const char *how, const DDX_VIDEO *video) {
    int size = video->width * video->height;
    printf("%s %d %d %dx%d %lu %lu %lu\n", how, video->frame, video->fields, video->width, video->height,
           sum(video->y, size), sum(video->u, size / 4), sum(video->v, size / 4));
    fflush(stdout);
}

int main(int argc, char **argv) {
    int count = argc > 1 ? atoi(argv[1]) : 1;
    int port = 0;
    double timeout = 5;
    DDX_TIME ts;
    DDX_STORE_ID *id = NULL;
    DDX_STORE_ITEM *item = NULL;
    DDX_VIDEO *live;
    static DDX_VIDEO copy;

    id = ddx_store_open(NULL, port, timeout);
    if (!id)
        return 1;
    while (!(item = ddx_store_lookup_item(id, "video", NULL, 0)))
        if (errno == EPROTOTYPE) { /* the video does not have the paper's type */
            fprintf(stderr, "%s\n", ddx_error_text(errno));
            ddx_store_close(id);
            return 3;
        }
    live = ddx_store_var_pointer(item);
    for (int i = 0; i < count; i++) {
        if (i % 2) {
            if (ddx_store_read(item, &copy, &ts, 5.0, 1))
                return 1;
            print("copy", &copy);
        } else {
            if (ddx_store_read_direct(item, &ts, 10.0, 1))
                return 1;
            print("live", live);
        }
    }
    ddx_store_close(id);
    return 0;
}
