/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxcatalog: links the stores of several machines. */
#include <pthread.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "catalog.h"

#define NICE 10          /* the robot comes first */
#define STACK (1u << 20) /* bytes: the default of 8 MiB would count against the service's memory limit */

static const char purpose[] =
    "Links this machine's store with those of other machines: item gps of machine carol is the item carol:gps here,\n"
    "and for ROS 2 the topic /carol/gps. An item is sent only while another machine reads it.";
static const char notes[] =
    "Counters: lost.store = overwritten in the store before it was read, lost.bandwidth = a newer value came before\n"
    "it could be sent, lost.size = larger than 16 MiB, lost.network = sent by another machine, but not arrived,\n"
    "lost.type = not of the announced type, lost.budget = no room in this store.";

static void limit_stacks(void) {
    pthread_attr_t attributes;

    pthread_attr_init(&attributes);
    pthread_attr_setstacksize(&attributes, STACK);
    pthread_setattr_default_np(&attributes);
    pthread_attr_destroy(&attributes);
}

int main(int argc, char **argv) {
    static struct catalog catalog;
    const char *config = NULL, *machine = NULL;
    char name[256] = "", error[CONFIG_ERROR_MAX];
    const struct option_entry options[] = {
        {"c", "FILE", "configuration: items that other machines may read, network", OPTION_TEXT, &config, 0, 0},
        {"machine", "NAME", "name of this machine for others (default: its host name)", OPTION_TEXT, &machine, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    catalog.program = (struct program){.name = "ddxcatalog", .purpose = purpose, .notes = notes, .options = options};

    program_start(&catalog.program, argc, argv);
    gethostname(name, sizeof name - 1);
    name[strcspn(name, ".")] = 0; /* without its domain */
    if (!name_is_machine(machine ? machine : name)) {
        say("-machine %.40s: a name of 1 to %d letters, digits, '-' and '_' is needed", machine ? machine : name,
            NAME_MACHINE - 1);
        return EXIT_USAGE;
    }
    strcpy(catalog.identity.host, machine ? machine : name);
    if (config_read(config, &catalog.config, error)) {
        say("%s", error);
        return EXIT_USAGE;
    }
    setpriority(PRIO_PROCESS, 0, NICE);
    limit_stacks();
    int status = catalog.program.check ? EXIT_OK : catalog_run(&catalog);
    config_free(&catalog.config);
    return status;
}
