/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A sensor's item with every feature of types: written once, or in a loop until killed ("hold"). */
#include <string.h>
#include <unistd.h>

#include "ddx.h"

DDX_STORE_TYPE(
    VECTOR, struct { float x, y, z; });
DDX_STORE_TYPE(
    SENSOR, struct {
        char name[12];
        struct {
            VECTOR accel[2];
            double bias[3];
            int8_t temperature;
        } imu;
        struct {
            uint8_t id;
            short gears[2][3];
        } wheel[3];
        uint64_t serial;
        float beam[40];
    });

int main(int argc, char **argv) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 1.0);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, "sensor", "SENSOR", sizeof(SENSOR));
    SENSOR sensor = {.name = "front", .imu = {.bias = {0.5, 0.25, 0.125}, .temperature = -40}, .serial = UINT64_MAX};

    if (!item)
        return 1;
    sensor.imu.accel[1].y = 9.75f;
    for (short i = 0; i < 6; i++)
        sensor.wheel[1].gears[i / 3][i % 3] = i;
    for (int i = 0; i < 40; i++)
        sensor.beam[i] = (float)i;
    do {
        if (ddx_store_write(item, &sensor, NULL))
            return 1;
        usleep(10000);
    } while (argc > 1 && !strcmp(argv[1], "hold"));
    ddx_store_close(id);
    return 0;
}
