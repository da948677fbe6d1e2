/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "ddx.h"

const char *ddx_error_text(int error) {
    switch (abs(error)) {
    case 0: return "no error";
    case ECONNREFUSED: return "no store runs here; start one with: ddxstore -m 8M";
    case ENOENT: return "the store has no item of this name; see: ddxctl list";
    case EPERM: return "the store's socket or its folder may be another user's; see DDX_DIR in ddx.h";
    case EPROTOTYPE: return "the item has another type, or one that the program has not declared";
    case EMSGSIZE:
        return "wrong size: the item's value does not fit the program's struct; if the struct has changed, first stop "
               "the programs that have the item open";
    case EEXIST: return "another program writes this item already";
    case ENOSPC: return "the store's memory budget is used up; give it more with: ddxstore -m";
    case EBUSY: return "no memory left for another reader, or a frame is still held";
    case ENOBUFS: return "every frame of the item is held, nothing was written";
    case EMFILE: return "too few descriptors: one is needed for each frame and each reader of an item; see ulimit -n";
    case ETIMEDOUT: return "nothing was written within the timeout";
    case EINVAL: return "bad argument, or a type that cannot be shared (ddx_type_problem() names the word)";
    case EOPNOTSUPP: return "no catalog runs here, through which other machines are reached; start one with: catalog";
    case EHOSTUNREACH: return "no machine of this name is known to the catalog; check its catalog, and the network";
    case EFBIG: return "its values are too large to be sent to other machines (16 MiB at most)";
    case ENOMEM: return "out of memory";
    case EDQUOT: return "this program has more items open than the store allows one program; close some of them";
    default: return strerror(abs(error));
    }
}
