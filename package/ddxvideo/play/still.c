/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "still.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

int still_take(struct still *still, const struct ddxvideo_picture *picture) {
    size_t bytes[3], sum = 0;

    for (int i = 0; i < 3; i++) {
        bytes[i] = (size_t)picture->stride[i] * (size_t)picture->rows[i];
        sum += bytes[i];
    }
    if (sum != still->size) {
        still_close(still);
        still->bytes = malloc(sum);
        if (!still->bytes)
            return -ENOMEM;
        still->size = sum;
    }
    still->picture = *picture;
    unsigned char *place = still->bytes;
    for (int i = 0; i < 3; i++) {
        still->picture.plane[i] = memcpy(place, picture->plane[i], bytes[i]);
        place += bytes[i];
    }
    return 0;
}

void still_close(struct still *still) {
    free(still->bytes);
    *still = (struct still){.size = 0};
}
