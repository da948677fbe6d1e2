/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "standard.h"

#include <ddx_time.h>
#include <endian.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "picture.h"

#define IMAGE "sensor_msgs/Image"
#define HEADER "std_msgs/Header"
#define STAMPED HEADER " header\n"
#define FIXED 12 /* a time stamp, length of the name */

static const struct message {
    const char *type, *fields;
} messages[] = {
    {"builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"},
    {HEADER, "builtin_interfaces/Time stamp\nstring frame_id\n"},
    {"std_msgs/Int8", "int8 data\n"},
    {"std_msgs/Int16", "int16 data\n"},
    {"std_msgs/Int32", "int32 data\n"},
    {"std_msgs/Int64", "int64 data\n"},
    {"std_msgs/UInt8", "uint8 data\n"},
    {"std_msgs/UInt16", "uint16 data\n"},
    {"std_msgs/UInt32", "uint32 data\n"},
    {"std_msgs/UInt64", "uint64 data\n"},
    {"std_msgs/Float32", "float32 data\n"},
    {"std_msgs/Float64", "float64 data\n"},
    {"std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n"},
    {"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/Vector3Stamped", STAMPED "geometry_msgs/Vector3 vector\n"},
    {"geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"},
    {"geometry_msgs/PointStamped", STAMPED "geometry_msgs/Point point\n"},
    {"geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"},
    {"geometry_msgs/QuaternionStamped", STAMPED "geometry_msgs/Quaternion quaternion\n"},
    {"geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"},
    {"geometry_msgs/PoseStamped", STAMPED "geometry_msgs/Pose pose\n"},
    {"geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance\n"},
    {"geometry_msgs/PoseWithCovarianceStamped", STAMPED "geometry_msgs/PoseWithCovariance pose\n"},
    {"geometry_msgs/Twist", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"},
    {"geometry_msgs/TwistStamped", STAMPED "geometry_msgs/Twist twist\n"},
    {"geometry_msgs/TwistWithCovariance", "geometry_msgs/Twist twist\nfloat64[36] covariance\n"},
    {"geometry_msgs/TwistWithCovarianceStamped", STAMPED "geometry_msgs/TwistWithCovariance twist\n"},
    {"geometry_msgs/Accel", "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"},
    {"geometry_msgs/AccelStamped", STAMPED "geometry_msgs/Accel accel\n"},
    {"geometry_msgs/Wrench", "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n"},
    {"geometry_msgs/WrenchStamped", STAMPED "geometry_msgs/Wrench wrench\n"},
    {"geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"},
    {"sensor_msgs/Imu",
     STAMPED "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
             "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
             "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"},
    {"sensor_msgs/MagneticField", STAMPED "geometry_msgs/Vector3 magnetic_field\n"
                                          "float64[9] magnetic_field_covariance\n"},
    {"sensor_msgs/NavSatStatus", "int8 status\nuint16 service\n"},
    {"sensor_msgs/NavSatFix",
     STAMPED "sensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n"
             "float64 altitude\nfloat64[9] position_covariance\nuint8 position_covariance_type\n"},
    {IMAGE, STAMPED "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n"},
    {"sensor_msgs/Temperature", STAMPED "float64 temperature\nfloat64 variance\n"},
    {"sensor_msgs/FluidPressure", STAMPED "float64 fluid_pressure\nfloat64 variance\n"},
    {"sensor_msgs/RelativeHumidity", STAMPED "float64 relative_humidity\nfloat64 variance\n"},
    {"sensor_msgs/Illuminance", STAMPED "float64 illuminance\nfloat64 variance\n"},
    {"sensor_msgs/Range", STAMPED "uint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\n"
                                  "float32 range\nfloat32 variance\n"},
};
#define MESSAGES (sizeof messages / sizeof *messages)

/* The index of "sensor_msgs/msg/Imu" or "sensor_msgs/Imu"; MESSAGES if it is not in the list. */
static size_t index_of(const char *type, size_t length) {
    size_t package = strcspn(type, "/"), skipped = !strncmp(type + package, "/msg/", 5) ? 4 : 0;

    for (size_t i = 0; package < length && i < MESSAGES; i++)
        if (strlen(messages[i].type) == length - skipped && !strncmp(messages[i].type, type, package) &&
            !strncmp(messages[i].type + package, type + package + skipped, length - skipped - package))
            return i;
    return MESSAGES;
}

/* Writes the fields of the message, and of all messages in it. */
static void write_schema(FILE *to, size_t index, bool written[MESSAGES]) {
    written[index] = true;
    fputs(messages[index].fields, to);
    for (const char *line = messages[index].fields; *line; line += strcspn(line, "\n") + 1) {
        size_t inner = index_of(line, strcspn(line, " "));

        if (inner == MESSAGES || written[inner])
            continue;
        fprintf(to, "MSG: %s\n", messages[inner].type);
        write_schema(to, inner, written);
    }
}

static int describe(size_t index, struct description **description) {
    bool written[MESSAGES] = {false};
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (!to)
        return -ENOMEM;
    write_schema(to, index, written);
    bool bad = ferror(to);
    int error = fclose(to) || bad ? -ENOMEM : description_parse(messages[index].type, text, description);
    free(text);
    return error;
}

struct comparison {
    const struct description *wanted, *given;
    char *why;
};

static const char *kind_name(const struct description_field *field) {
    static const char *const names[] = {"struct", "int8",  "uint8",  "int16",   "uint16", "int32",
                                        "uint32", "int64", "uint64", "float32", "float64"};

    return field->kind >= DESCRIPTION_NESTED && field->kind <= DESCRIPTION_DOUBLE ? names[field->kind - 1] : "string";
}

static void field_text(const struct description_field *field, char text[64]) {
    int length = snprintf(text, 64, "%s", kind_name(field));

    if (field->count)
        snprintf(text + length, (size_t)(64 - length), "[%u]", (unsigned)field->count);
}

static bool same_messages(const struct comparison *comparison, const struct description_message *wanted, unsigned first,
                          const struct description_message *given, const char *prefix);

static bool same_field(const struct comparison *comparison, const struct description_field *wanted,
                       const struct description_field *given, const char *prefix) {
    char path[STANDARD_WHY], texts[2][64];

    snprintf(path, sizeof path, "%s%s", prefix, wanted->name);
    if (strcmp(wanted->name, given->name)) {
        snprintf(comparison->why, STANDARD_WHY, "instead of field %.60s it has %.60s", path, given->name);
        return false;
    }
    if (wanted->kind != given->kind || wanted->count != given->count) {
        field_text(wanted, texts[0]);
        field_text(given, texts[1]);
        snprintf(comparison->why, STANDARD_WHY, "its field %.60s is %s, not %s", path, texts[1], texts[0]);
        return false;
    }
    strncat(path, ".", sizeof path - strlen(path) - 1);
    return wanted->kind != DESCRIPTION_NESTED ||
           same_messages(comparison, description_find(comparison->wanted, wanted->type), 0,
                         description_find(comparison->given, given->type), path);
}

/* Skips the first fields of the wanted message. */
static bool same_messages(const struct comparison *comparison, const struct description_message *wanted, unsigned first,
                          const struct description_message *given, const char *prefix) {
    for (unsigned i = 0; first + i < wanted->count && i < given->count; i++)
        if (!same_field(comparison, &wanted->fields[first + i], &given->fields[i], prefix))
            return false;
    if (wanted->count == first + given->count)
        return true;
    bool lacks = wanted->count > first + given->count;
    snprintf(comparison->why, STANDARD_WHY, "it %s field %.40s%.60s", lacks ? "lacks" : "has one more,", prefix,
             lacks ? wanted->fields[first + given->count].name : given->fields[wanted->count - first].name);
    return false;
}

static int compare(const struct standard *standard, const struct form *form, char why[STANDARD_WHY]) {
    struct description *given;

    if (standard->is_picture && !picture_is(form))
        snprintf(why, STANDARD_WHY, "its type is %.63s, not DDX_VIDEO", form->type);
    if (standard->is_picture)
        return picture_is(form) ? 0 : -EINVAL;
    int error = description_parse(form->schema_name, form->schema, &given);
    if (error)
        return error;
    const struct comparison comparison = {standard->description, given, why};
    bool same = same_messages(&comparison, standard->description->messages, standard->has_header, given->messages, "");
    description_free(given);
    return same ? 0 : -EINVAL;
}

int standard_open(const char *type, const struct form *form, struct standard **result, char why[STANDARD_WHY]) {
    size_t index = index_of(type, strlen(type));

    if (index == MESSAGES)
        return -ENOENT;
    struct standard *standard = calloc(1, sizeof *standard);
    int error = standard ? describe(index, &standard->description) : -ENOMEM;
    if (!error) {
        standard->is_picture = !strcmp(messages[index].type, IMAGE);
        standard->has_header = !strcmp(standard->description->messages->fields->type, HEADER);
    }
    if (!error && form)
        error = compare(standard, form, why);
    if (error)
        standard_close(standard);
    else
        *result = standard;
    return error;
}

void standard_close(struct standard *standard) {
    if (standard)
        description_free(standard->description);
    free(standard);
}

size_t standard_size(const struct standard *standard, const struct form *form, const char *machine) {
    return FORM_HEADER + FIXED + strlen(machine) + 1 +
           (standard->is_picture ? picture_size(form) : form->message_size + 7);
}

static size_t put(unsigned char *message, size_t at, uint32_t number) {
    uint32_t little = htole32(number);

    memcpy(message + at, &little, sizeof little);
    return at + sizeof little;
}

/* Each number is aligned by its own size, from the end of CDR's header on. */
static size_t aligned(size_t at, size_t bytes) {
    return (at - FORM_HEADER + bytes - 1) / bytes * bytes + FORM_HEADER;
}

static size_t put_header(const char *machine, int64_t wall, unsigned char *message, size_t at) {
    size_t length = strlen(machine) + 1;

    at = put(message, at, (uint32_t)(wall / SECOND));
    at = put(message, at, (uint32_t)(wall % SECOND));
    at = put(message, at, (uint32_t)length);
    memcpy(message + at, machine, length);
    return at + length;
}

static size_t put_fields(const struct form *form, const void *value, unsigned char *message, size_t at) {
    for (unsigned i = 0; i < form->leaf_count; i++) {
        const struct form_leaf *leaf = &form->leaves[i];
        size_t bytes = (size_t)leaf->bytes * leaf->count, begin = aligned(at, leaf->bytes);

        memset(message + at, 0, begin - at);
        memcpy(message + begin, (const unsigned char *)value + leaf->item, bytes);
        at = begin + bytes;
    }
    return at;
}

size_t standard_write(const struct standard *standard, const struct form *form, const struct envelope *envelope,
                      const void *value, unsigned char *message) {
    static const unsigned char header[FORM_HEADER] = {0, 1, 0, 0}; /* CDR, little endian */
    int64_t wall = standard->is_picture ? picture_time(form, value, envelope->wall) : envelope->wall;
    size_t at = FORM_HEADER;

    memcpy(message, header, sizeof header);
    if (standard->has_header)
        at = put_header(envelope->machine, wall, message, at);
    return standard->is_picture ? picture_write(form, value, message, at) : put_fields(form, value, message, at);
}

/* Where the fields begin; 0: the message is too short for its header. */
static size_t fields_at(const struct standard *standard, const unsigned char *message, size_t size) {
    uint32_t little;

    if (!standard->has_header)
        return FORM_HEADER;
    if (size < FORM_HEADER + FIXED)
        return 0;
    memcpy(&little, message + FORM_HEADER + FIXED - sizeof little, sizeof little);
    uint32_t length = le32toh(little);
    return length && length <= size - FORM_HEADER - FIXED ? FORM_HEADER + FIXED + length : 0;
}

bool standard_check(const struct standard *standard, const struct form *form, const unsigned char *message,
                    size_t size) {
    if (standard->is_picture || size < FORM_HEADER || message[0] || message[1] != 1) /* CDR, little endian */
        return false;
    size_t at = fields_at(standard, message, size);
    if (!at)
        return false;
    for (unsigned i = 0; i < form->leaf_count; i++)
        at = aligned(at, form->leaves[i].bytes) + (size_t)form->leaves[i].bytes * form->leaves[i].count;
    return size >= at && size - at < 4; /* DDS pads messages to four bytes */
}

void standard_read(const struct standard *standard, const struct form *form, const unsigned char *message,
                   void *value) {
    size_t at = fields_at(standard, message, SIZE_MAX);

    for (unsigned i = 0; i < form->leaf_count; i++) {
        const struct form_leaf *leaf = &form->leaves[i];
        size_t bytes = (size_t)leaf->bytes * leaf->count;

        at = aligned(at, leaf->bytes);
        memcpy((unsigned char *)value + leaf->item, message + at, bytes);
        at += bytes;
    }
}
