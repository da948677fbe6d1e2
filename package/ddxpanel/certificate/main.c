/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * panel-certificate FOLDER NAME: the panel's key and certificate, for NAME and NAME.local, in FOLDER/panel.pem. They
 * are made if there are none, or if they are for another name. Prints the certificate's SHA-256, as browsers show it.
 */
#include <errno.h>
#include <fcntl.h>
#include <mbedtls/ctr_drbg.h>
#include <mbedtls/ecp.h>
#include <mbedtls/entropy.h>
#include <mbedtls/oid.h>
#include <mbedtls/pk.h>
#include <mbedtls/sha256.h>
#include <mbedtls/version.h>
#include <mbedtls/x509_crt.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define NAME_MAX_BYTES 63
#define TEXT_MAX 4096 /* of the file */
#define SHA256_BYTES 32
/* Right with any clock. Apple limits certificates to 825 days only if they begin after June 2019. */
#define BEGIN "20190101000000"
#define END "20491231235959"

#define DER_SEQUENCE 0x30
#define DER_DNS_NAME 0x82 /* of a subjectAltName */
#define LOCAL ".local"

struct maker {
    mbedtls_entropy_context entropy;
    mbedtls_ctr_drbg_context random;
    mbedtls_pk_context key;
    mbedtls_x509write_cert certificate;
};

_Noreturn static void fail(const char *what, const char *why) {
    fprintf(stderr, "panel-certificate: %s: %s\n", what, why);
    exit(1);
}

static bool is_name(const char *name) {
    size_t length = strspn(name, "abcdefghijklmnopqrstuvwxyz0123456789-");

    return length && length <= NAME_MAX_BYTES && !name[length];
}

/* ---- Making ---- */

static size_t add_name(unsigned char *der, const char *name, const char *suffix) {
    size_t length = strlen(name) + strlen(suffix);

    der[0] = DER_DNS_NAME;
    der[1] = (unsigned char)length; /* below 128: one byte */
    memcpy(der + 2, name, strlen(name));
    memcpy(der + 2 + strlen(name), suffix, strlen(suffix));
    return 2 + length;
}

/* NAME and NAME.local, as the value of the extension. */
static int set_names(mbedtls_x509write_cert *certificate, const char *name) {
    unsigned char names[2 * (2 + NAME_MAX_BYTES) + sizeof LOCAL], der[sizeof names + 3];
    size_t size = add_name(names, name, "");

    size += add_name(names + size, name, LOCAL);
    size_t head = 0;
    der[head++] = DER_SEQUENCE;
    if (size > 127)
        der[head++] = 0x81; /* one more byte of length */
    der[head++] = (unsigned char)size;
    memcpy(der + head, names, size);
    return mbedtls_x509write_crt_set_extension(certificate, MBEDTLS_OID_SUBJECT_ALT_NAME,
                                               MBEDTLS_OID_SIZE(MBEDTLS_OID_SUBJECT_ALT_NAME), 0, der, head + size);
}

static int set_purpose(mbedtls_x509write_cert *certificate) {
    /* SEQUENCE { serverAuth } */
    static const unsigned char der[] = {DER_SEQUENCE, 10, 6, 8, 0x2b, 6, 1, 5, 5, 7, 3, 1};

    return mbedtls_x509write_crt_set_extension(certificate, MBEDTLS_OID_EXTENDED_KEY_USAGE,
                                               MBEDTLS_OID_SIZE(MBEDTLS_OID_EXTENDED_KEY_USAGE), 0, der, sizeof der);
}

/* Random: browsers refuse two certificates of one issuer with the same number. */
static int set_serial(struct maker *maker) {
    unsigned char serial[16];
    int error = mbedtls_ctr_drbg_random(&maker->random, serial, sizeof serial);

    serial[0] = (unsigned char)((serial[0] & 0x3f) | 0x40); /* positive, and without leading zeros */
#if MBEDTLS_VERSION_NUMBER >= 0x03040000
    return error ? error : mbedtls_x509write_crt_set_serial_raw(&maker->certificate, serial, sizeof serial);
#else
    mbedtls_mpi number;

    mbedtls_mpi_init(&number);
    if (!error)
        error = mbedtls_mpi_read_binary(&number, serial, sizeof serial);
    if (!error)
        error = mbedtls_x509write_crt_set_serial(&maker->certificate, &number);
    mbedtls_mpi_free(&number);
    return error;
#endif
}

static int make(struct maker *maker, const char *name, char text[TEXT_MAX]) {
    mbedtls_x509write_cert *certificate = &maker->certificate;
    char subject[NAME_MAX_BYTES + 4];
    int error;

    snprintf(subject, sizeof subject, "CN=%s", name);
    mbedtls_x509write_crt_set_version(certificate, MBEDTLS_X509_CRT_VERSION_3);
    mbedtls_x509write_crt_set_md_alg(certificate, MBEDTLS_MD_SHA256);
    mbedtls_x509write_crt_set_subject_key(certificate, &maker->key);
    mbedtls_x509write_crt_set_issuer_key(certificate, &maker->key);
    if ((error = mbedtls_ctr_drbg_seed(&maker->random, mbedtls_entropy_func, &maker->entropy, NULL, 0)) ||
        (error = mbedtls_pk_setup(&maker->key, mbedtls_pk_info_from_type(MBEDTLS_PK_ECKEY))) ||
        (error = mbedtls_ecp_gen_key(MBEDTLS_ECP_DP_SECP256R1, mbedtls_pk_ec(maker->key), mbedtls_ctr_drbg_random,
                                     &maker->random)) ||
        (error = set_serial(maker)) || (error = mbedtls_x509write_crt_set_subject_name(certificate, subject)) ||
        (error = mbedtls_x509write_crt_set_issuer_name(certificate, subject)) ||
        (error = mbedtls_x509write_crt_set_validity(certificate, BEGIN, END)) ||
        (error = mbedtls_x509write_crt_set_basic_constraints(certificate, 0, -1)) ||
        (error = mbedtls_x509write_crt_set_key_usage(certificate, MBEDTLS_X509_KU_DIGITAL_SIGNATURE)) ||
        (error = set_purpose(certificate)) || (error = set_names(certificate, name)) ||
        (error = mbedtls_pk_write_key_pem(&maker->key, (unsigned char *)text, TEXT_MAX)))
        return error;
    size_t size = strlen(text);
    return mbedtls_x509write_crt_pem(certificate, (unsigned char *)text + size, TEXT_MAX - size,
                                     mbedtls_ctr_drbg_random, &maker->random);
}

static int make_text(const char *name, char text[TEXT_MAX]) {
    struct maker maker;

    mbedtls_entropy_init(&maker.entropy);
    mbedtls_ctr_drbg_init(&maker.random);
    mbedtls_pk_init(&maker.key);
    mbedtls_x509write_crt_init(&maker.certificate);
    int error = make(&maker, name, text);
    mbedtls_x509write_crt_free(&maker.certificate);
    mbedtls_pk_free(&maker.key);
    mbedtls_ctr_drbg_free(&maker.random);
    mbedtls_entropy_free(&maker.entropy);
    return error;
}

/* ---- Files ---- */

/* Replaces the file as a whole: after a power cut it is the old one or the new one. */
static int keep(const char *folder, const char *path, const char *text) {
    char new[PATH_MAX + 8];
    size_t size = strlen(text);

    snprintf(new, sizeof new, "%s.new", path);
    unlink(new);
    int fd = open(new, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (fd < 0)
        return -errno;
    int error = write(fd, text, size) != (ssize_t)size || fsync(fd) ? -EIO : 0;
    close(fd);
    if (!error && rename(new, path))
        error = -errno;
    if (error)
        return error;
    fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd >= 0) {
        fsync(fd);
        close(fd);
    }
    return 0;
}

/* Whether the file has a certificate for this name; then *sum is its SHA-256. */
static bool read_back(const char *path, const char *name, unsigned char sum[SHA256_BYTES]) {
    char subject[NAME_MAX_BYTES + 4] = "", wanted[NAME_MAX_BYTES + 4];
    mbedtls_x509_crt certificate;

    mbedtls_x509_crt_init(&certificate);
    snprintf(wanted, sizeof wanted, "CN=%s", name);
    bool good = !mbedtls_x509_crt_parse_file(&certificate, path) &&
                mbedtls_x509_dn_gets(subject, sizeof subject, &certificate.subject) > 0 && !strcmp(subject, wanted);
#if MBEDTLS_VERSION_NUMBER >= 0x03000000
    good = good && !mbedtls_sha256(certificate.raw.p, certificate.raw.len, sum, 0);
#else
    good = good && !mbedtls_sha256_ret(certificate.raw.p, certificate.raw.len, sum, 0);
#endif
    mbedtls_x509_crt_free(&certificate);
    return good;
}

int main(int argc, char **argv) {
    unsigned char sum[SHA256_BYTES];
    char path[PATH_MAX], text[TEXT_MAX] = "";

    if (argc != 3 || !is_name(argv[2])) {
        fprintf(stderr, "usage: panel-certificate FOLDER NAME, a host's name in small letters\n");
        return 2;
    }
    const char *folder = argv[1], *name = argv[2];
    umask(077);
    if (mkdir(folder, 0700) && errno != EEXIST)
        fail(folder, strerror(errno));
    snprintf(path, sizeof path, "%s/panel.pem", folder);
    if (!read_back(path, name, sum)) {
        int error = make_text(name, text);
        if (error)
            fail("mbedtls", error < 0 ? "no certificate can be made" : "?");
        error = keep(folder, path, text);
        explicit_bzero(text, sizeof text);
        if (error)
            fail(path, strerror(-error));
        if (!read_back(path, name, sum))
            fail(path, "it does not read back");
    }
    for (int i = 0; i < SHA256_BYTES; i++)
        printf("%s%02X", i ? ":" : "", sum[i]);
    putchar('\n');
    return 0;
}
