/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The manual's example, complete: one program writes positions, another reads them in both of the paper's ways.
 *
 *     ./example write &      ./example
 */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "ddx.h"

DDX_STORE_TYPE(
    POSITION, struct {
        int number;
        double x, y;
    });

static int write_positions(DDX_STORE_ID *id) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, "position", "POSITION", sizeof(POSITION));
    POSITION position = {0, 0.5, -0.5};

    if (!item)
        return 1;
    for (int i = 1; i <= 20; i++) {
        position.number = i;
        int error = ddx_store_write(item, &position, NULL);
        if (error) {
            fprintf(stderr, "position: %s\n", ddx_error_text(error));
            return 1;
        }
        usleep(20000);
    }
    return 0;
}

static int read_positions(DDX_STORE_ID *id) {
    DDX_STORE_ITEM *item = NULL;
    POSITION copy, *live;
    DDX_TIME ts;

    while (!(item = ddx_store_lookup_item(id, "position", NULL, 0)))
        usleep(1000);                             /* no writer yet */
    if (ddx_store_read(item, &copy, &ts, 1.0, 1)) /* copies; waits up to 1.0 s for the next write */
        return 1;
    printf("%d: %.1f %.1f\n", copy.number, copy.x, copy.y);
    live = ddx_store_var_pointer(item);
    if (!live || ddx_store_read_direct(item, &ts, 1.0, 1)) /* no copy */
        return 1;
    printf("%d: %.1f %.1f\n", live->number, live->x, live->y);
    return live->number > copy.number && live->x == 0.5 ? 0 : 1;
}

int main(int argc, char **argv) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 1.0); /* this machine, the usual port */
    int status;

    if (!id) {
        perror("no store");
        return 1;
    }
    status = argc > 1 && !strcmp(argv[1], "write") ? write_positions(id) : read_positions(id);
    ddx_store_close(id); /* closes its items as well */
    return status;
}
