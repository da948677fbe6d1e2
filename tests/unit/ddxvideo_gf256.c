/* SPDX-License-Identifier: GPL-2.0-or-later */
/* GF(256), the random numbers of RFC 8682 and the coefficients of RFC 8681. */
#include "gf256.h"

#include "check.h"

static uint8_t product[256][256];

static void test_field(void) {
    for (unsigned a = 0; a < 256; a++)
        for (unsigned b = 0; b < 256; b++)
            product[a][b] = gf256_multiply((uint8_t)a, (uint8_t)b);
    CHECK_EQUAL(product[2][128], 0x1d);
    unsigned power = 1;
    for (unsigned i = 1; i < 256; i++) { /* 2 generates the field (RFC 6865): the polynomial is primitive */
        power = product[power][2];
        CHECK((power == 1) == (i == 255));
    }
    for (unsigned a = 0; a < 256; a++) {
        CHECK_EQUAL(product[a][0], 0);
        CHECK_EQUAL(product[a][1], a);
        CHECK(!a || product[a][gf256_inverse((uint8_t)a)] == 1);
        for (unsigned b = 0; b < 256; b++) {
            CHECK_EQUAL(product[a][b], product[b][a]);
            CHECK(!a || !b || product[a][b]);
            for (unsigned c = 0; c < 256; c++) {
                CHECK(product[product[a][b]][c] == product[a][product[b][c]]);
                CHECK(product[a][b ^ c] == (product[a][b] ^ product[a][c]));
            }
        }
    }
}

/* Each factor, size up to 40 bytes and alignment equals single products, and bytes around them stay. */
static void test_rows(void) {
    for (unsigned factor = 0; factor < 256; factor++) {
        for (unsigned size = 0; size < 40; size++) {
            uint8_t from[64], to[64], expected[64];
            unsigned at = (factor + size) % 8, source = size % 8;
            for (unsigned i = 0; i < 64; i++) {
                from[i] = (uint8_t)(factor * 31 + size + i * 77);
                to[i] = expected[i] = (uint8_t)(i * 151 + factor);
            }
            for (unsigned i = 0; i < size; i++)
                expected[at + i] ^= product[factor][from[source + i]];
            gf256_add(to + at, from + source, (uint8_t)factor, size);
            CHECK(!memcmp(to, expected, sizeof to));
            for (unsigned i = 0; i < size; i++)
                expected[at + i] = product[factor][expected[at + i]];
            gf256_scale(to + at, (uint8_t)factor, size);
            CHECK(!memcmp(to, expected, sizeof to));
        }
    }
    for (unsigned size = 0; size < 40; size++) {
        uint8_t data[41] = {0};
        data[size] = 1;
        CHECK(gf256_is_zero(data, size));
        CHECK(!gf256_is_zero(data, size + 1));
    }
}

/* RFC 8682, figure 2. */
static void test_random(void) {
    static const uint32_t expected[] = {
        2545341989, 981918433,  3715302833, 2387538352, 3591001365, 3820442102, 2114400566, 2196103051, 2783359912,
        764534509,  643179475,  1822416315, 881558334,  4207026366, 3690273640, 3240535687, 2921447122, 3984931427,
        4092394160, 44209675,   2188315343, 2908663843, 1834519336, 3774670961, 3019990707, 4065554902, 1239765502,
        4035716197, 3412127188, 552822483,  161364450,  353727785,  140085994,  149132008,  2547770827, 4064042525,
        4078297538, 2057335507, 622384752,  2041665899, 2193913817, 1080849512, 33160901,   662956935,  642999063,
        3384709977, 1723175122, 3866752252, 521822317,  2292524454};
    struct tinymt32 random;
    tinymt32_init(&random, 1);
    for (unsigned i = 0; i < sizeof expected / sizeof *expected; i++)
        CHECK_EQUAL(tinymt32_next(&random), expected[i]);
}

/* Figures of another implementation of RFC 8681 (swif-codec); the sum is over 32 coefficients of each key. */
static void test_coefficients(void) {
    static const struct {
        uint16_t key;
        uint8_t first[12], last;
    } expected[] = {{0, {39, 42, 153, 208, 176, 219, 77, 72, 133, 163, 38, 172}, 218},
                    {1, {37, 225, 177, 176, 21, 246, 54, 139, 168, 237, 211, 187}, 168},
                    {2, {249, 140, 98, 88, 123, 116, 116, 112, 63, 216, 142, 225}, 204},
                    {12345, {126, 101, 239, 226, 104, 130, 6, 188, 113, 120, 70, 70}, 239},
                    {65535, {52, 199, 76, 244, 208, 206, 112, 248, 248, 73, 120, 100}, 183}};
    uint8_t found[256];
    for (unsigned i = 0; i < sizeof expected / sizeof *expected; i++) {
        repair_coefficients(expected[i].key, found, 256);
        CHECK(!memcmp(found, expected[i].first, sizeof expected[i].first));
        CHECK_EQUAL(found[255], expected[i].last);
    }
    uint32_t sum = 0;
    for (unsigned key = 0; key < 65536; key++) {
        repair_coefficients((uint16_t)key, found, 32);
        for (unsigned i = 0; i < 32; i++) {
            CHECK(found[i]);
            sum = sum * 31 + found[i];
        }
    }
    CHECK_EQUAL(sum, 3506565978u);
}

int main(void) {
    test_field();
    test_rows();
    test_random();
    test_coefficients();
    return 0;
}
