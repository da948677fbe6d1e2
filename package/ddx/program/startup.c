/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "startup.h"

#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define OS_RELEASE "/etc/os-release"

void descriptors_open(void) {
    int fd;

    do
        fd = open("/dev/null", O_RDWR);
    while (fd >= 0 && fd <= STDERR_FILENO);
    if (fd >= 0)
        close(fd);
}

void version_print(const char *name) {
    char line[256], image[256] = "";
    bool ours = false;
    FILE *file = fopen(OS_RELEASE, "re");

    printf("%s %s\n", name, DDX_VERSION);
    if (!file)
        return;
    while (fgets(line, sizeof line, file)) {
        if (!strcmp(line, "ID=ddxvideo\n"))
            ours = true;
        sscanf(line, "VERSION=\"%255[^\"\n]", image);
    }
    fclose(file);
    if (ours && *image)
        printf("image: %s\n", image);
}
