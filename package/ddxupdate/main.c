/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxupdate: keeps the boot loader's block. Scripts call it. */
#include <descriptors.h>
#include <stdio.h>
#include <string.h>
#include <version.h>

#include "command.h"
#include "message.h"

static const char usage[] = "usage: ddxupdate [-root FOLDER] block BOOT\n"
                            "\n"
                            "  block         report to the boot loader that this slot has come up\n"
                            "\n"
                            "  BOOT          device of the boot partition\n"
                            "  -root FOLDER  use the machine's files below this folder: proc, run, data\n"
                            "  -help         this text; -version\n"
                            "\n"
                            "Exit status: 0, 1 failed, 2 bad usage: nothing was written.\n";

int main(int count, char **words) {
    struct request request = {0};
    const char *root = "";
    int at = 1;

    descriptors_open();
    if (count == 2 && (!strcmp(words[1], "-help") || !strcmp(words[1], "--help")))
        return fputs(usage, stdout) < 0;
    if (count == 2 && (!strcmp(words[1], "-version") || !strcmp(words[1], "--version"))) {
        version_print("ddxupdate");
        return 0;
    }
    if (count > 2 && !strcmp(words[1], "-root")) {
        root = words[2];
        at = 3;
    }
    if (count - at != 2 || strcmp(words[at], "block") != 0)
        return fail(2, "bad usage; see ddxupdate -help");
    request.boot = words[at + 1];
    place_find(&request.place, root);
    return command_block(&request);
}
