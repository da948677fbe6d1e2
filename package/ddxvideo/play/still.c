/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "still.h"

#include <errno.h>
#include <stdlib.h>

#include "video_layout.h"

int still_take(struct still *still, const struct ddxvideo_picture *picture) {
    size_t size = video_layout_bytes(&picture->geometry);

    if (size != still->size) {
        still_close(still);
        still->bytes = malloc(size);
        if (!still->bytes)
            return -ENOMEM;
        still->size = size;
    }
    video_layout_copy(&still->picture, picture, still->bytes);
    return 0;
}

void still_close(struct still *still) {
    free(still->bytes);
    *still = (struct still){.size = 0};
}
