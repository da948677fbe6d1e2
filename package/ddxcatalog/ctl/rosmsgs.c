/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxctl rosmsgs DIR: the types of all items as a ROS 2 package, so that programs of ROS know them. */
#include <ddx.h>
#include <envelope.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define PACKAGE "ddx"
#define STORE_WAIT 1.0 /* s */
#define FILE_NAME 200

static const char usage[] =
    "  rosmsgs DIR   the types of all items as package " PACKAGE " of ROS 2, into DIR/" PACKAGE "\n";
static const char manifest[] =
    "<?xml version=\"1.0\"?>\n<package format=\"3\">\n  <name>" PACKAGE "</name>\n  <version>0.0.0</version>\n"
    "  <description>Types of the items of a DDX store</description>\n"
    "  <maintainer email=\"root@localhost\">root</maintainer>\n  <license>none</license>\n"
    "  <buildtool_depend>ament_cmake</buildtool_depend>\n"
    "  <buildtool_depend>rosidl_default_generators</buildtool_depend>\n  <depend>std_msgs</depend>\n"
    "  <exec_depend>rosidl_default_runtime</exec_depend>\n"
    "  <member_of_group>rosidl_interface_packages</member_of_group>\n"
    "  <export><build_type>ament_cmake</build_type></export>\n</package>\n";
static const char recipe[] =
    "cmake_minimum_required(VERSION 3.8)\nproject(" PACKAGE ")\nfind_package(ament_cmake REQUIRED)\n"
    "find_package(rosidl_default_generators REQUIRED)\nfind_package(std_msgs REQUIRED)\n"
    "file(GLOB messages RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} msg/*.msg)\n"
    "rosidl_generate_interfaces(${PROJECT_NAME} ${messages} DEPENDENCIES std_msgs)\nament_package()\n";

__attribute__((format(printf, 1, 2))) static int failed(const char *format, ...) {
    va_list arguments;

    fputs("ddxctl: rosmsgs: ", stderr);
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
    return 1;
}

/* Opens a folder below another, and creates it if necessary; -1 and errno. */
static int open_folder(int below, const char *name) {
    if (mkdirat(below, name, 0777) && errno != EEXIST)
        return -1;
    return openat(below, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
}

/* Writes a new file, whole or not at all. */
static int write_file(int folder, const char *name, const char *text) {
    static const char temporary[] = ".new";
    int descriptor = openat(folder, temporary, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0666);
    FILE *file = descriptor < 0 ? NULL : fdopen(descriptor, "w");

    if (!file)
        return failed("%s: %s", name, strerror(errno));
    bool bad = fputs(text, file) < 0;
    if (fclose(file) || bad || renameat(folder, temporary, folder, name)) {
        unlinkat(folder, temporary, 0);
        return failed("%s: %s", name, strerror(errno));
    }
    return 0;
}

static char *text_of(const struct description_message *message) {
    static const char *const kinds[] = {
        [DESCRIPTION_INT8] = "int8",      [DESCRIPTION_UINT8] = "uint8",   [DESCRIPTION_INT16] = "int16",
        [DESCRIPTION_UINT16] = "uint16",  [DESCRIPTION_INT32] = "int32",   [DESCRIPTION_UINT32] = "uint32",
        [DESCRIPTION_INT64] = "int64",    [DESCRIPTION_UINT64] = "uint64", [DESCRIPTION_FLOAT] = "float32",
        [DESCRIPTION_DOUBLE] = "float64", [DESCRIPTION_STRING] = "string"};
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    for (unsigned i = 0; to && i < message->count; i++) {
        const struct description_field *field = &message->fields[i];

        fputs(field->kind == DESCRIPTION_NESTED ? field->type : kinds[field->kind], to);
        if (field->count)
            fprintf(to, "[%u]", (unsigned)field->count);
        fprintf(to, " %s\n", field->name);
    }
    if (!to || fclose(to)) {
        free(text);
        return NULL;
    }
    return text;
}

struct written {
    struct written *next;
    char type[DESCRIPTION_NAME];
    char *text;
};

/* Two items may have the same type. Of two types with the same name, the first one is written. */
static int put(struct written **all, int folder, const struct description_message *message, const char *item) {
    char name[FILE_NAME], *text = text_of(message);
    struct written *written = *all;

    while (written && strcmp(written->type, message->type))
        written = written->next;
    if (text && written) {
        bool same = !strcmp(written->text, text);
        free(text);
        return same ? 0 : failed("%s: another item has another type %s; this one is left out", item, message->type);
    }
    if (!text || !(written = calloc(1, sizeof *written))) {
        free(text);
        return failed("%s: no memory", item);
    }
    strcpy(written->type, message->type);
    written->text = text;
    written->next = *all;
    *all = written;
    snprintf(name, sizeof name, "%s.msg", message->type + strlen(PACKAGE "/"));
    return write_file(folder, name, text);
}

static int put_item(struct written **all, int folder, DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    struct description *description = NULL;
    struct form *form = NULL;
    int error = item ? form_of_item(item, &form) : -errno, status = 0;

    if (!error)
        error = envelope_describe(form, &description);
    if (error)
        status = failed("%s: %s", name, ddx_error_text(error));
    for (unsigned i = 0; !error && i < description->count; i++)
        if (!strncmp(description->messages[i].type, PACKAGE "/", strlen(PACKAGE "/")))
            status |= put(all, folder, &description->messages[i], name);
    description_free(description);
    form_free(form);
    ddx_store_done_item(item);
    return status;
}

static int put_all(int folder, DDX_STORE_ID *id) {
    struct written *all = NULL;
    struct ddx_item_info *items;
    unsigned count;
    int status = 0, error = ddx_store_list(id, NULL, &items, &count);

    if (error)
        return failed("%s", ddx_error_text(error));
    for (unsigned i = 0; i < count; i++)
        if (*items[i].type) /* otherwise it is only awaited */
            status |= put_item(&all, folder, id, items[i].name);
    free(items);
    while (all) {
        struct written *written = all;

        all = written->next;
        free(written->text);
        free(written);
    }
    return status;
}

static int write_package(const char *place, DDX_STORE_ID *id) {
    int outer = open_folder(AT_FDCWD, place);
    int package = outer < 0 ? -1 : open_folder(outer, PACKAGE);
    int messages = package < 0 ? -1 : open_folder(package, "msg");

    if (messages < 0)
        return failed("%s: %s", place, strerror(errno));
    int status = write_file(package, "package.xml", manifest) | write_file(package, "CMakeLists.txt", recipe);
    return put_all(messages, id) | status;
}

int main(int argc, char **argv) {
    if (argc == 2 && (!strcmp(argv[1], "-help") || !strcmp(argv[1], "--help"))) {
        fputs(usage, stdout);
        return 0;
    }
    if (argc != 2 || *argv[1] == '-') {
        failed("name the folder for the package: ddxctl rosmsgs DIR");
        return 2;
    }
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, STORE_WAIT);
    if (!id)
        return failed("%s", ddx_error_text(-errno));
    int status = write_package(argv[1], id);
    ddx_store_close(id);
    return status;
}
