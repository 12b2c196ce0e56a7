/* What a process in the sandbox can and cannot do, and Draco files decoded in one. */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"
#include "decode.h"
#include "format/draco_child.h"
#include "format/encoder.h"
#include "format/sandbox.h"
#include "shapes.h"

#define MEMORY ((size_t)256 << 20)

/* ---- the sandbox ---- */

/** Runs a deed in a sandbox of its own; returns how the process ended. */
static int run(void (*deed)(void))
{
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) {
        qm_sandbox_limits limits = {MEMORY, 1};
        if (!qm_sandbox_enter(&limits)) _exit(100);
        deed();
        _exit(0);
    }
    int status;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    return status;
}

static void compute(void)
{
    char *block = malloc(MEMORY / 8);
    if (!block) _exit(1);
    memset(block, 1, MEMORY / 8);
    free(block);
    if (write(STDERR_FILENO, "", 0) != 0) _exit(2);
}

static void take_too_much(void)
{
    void *volatile block = malloc(2 * MEMORY);
    _exit(block ? 1 : 0);
}

static void open_file(void)
{
    _exit(open("/etc/passwd", O_RDONLY) >= 0);
}

static void make_socket(void)
{
    _exit(socket(AF_INET, SOCK_STREAM, 0) >= 0);
}

static void start_process(void)
{
    _exit(fork() > 0);
}

static void spin(void)
{
    for (volatile unsigned i = 0;; i++)
        continue;
}

static void test_a_process_may_compute_and_nothing_else(void **state)
{
    (void)state;
    int status = run(compute);
    QM_CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0, "status %d", status);
    status = run(take_too_much);
    QM_CHECK(WIFEXITED(status) && WEXITSTATUS(status) == 0, "status %d", status);
    void (*const forbidden[])(void) = {open_file, make_socket, start_process};
    for (size_t i = 0; i < 3; i++) {
        status = run(forbidden[i]);
        QM_CHECK(WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS, "deed %zu: status %d", i, status);
    }
}

static void test_the_time_of_the_processor_is_limited(void **state)
{
    (void)state;
    int status = run(spin);
    QM_CHECK(WIFSIGNALED(status), "status %d", status);
    assert_true(WTERMSIG(status) == SIGXCPU || WTERMSIG(status) == SIGKILL);
}

/* ---- Draco in a child ---- */

static char daemon_program[4096];

/** The daemon of this build is beside the folder of this test. */
static void find_daemon(void)
{
    ssize_t length = readlink("/proc/self/exe", daemon_program, sizeof daemon_program - 16);
    assert_true(length > 0);
    daemon_program[length] = '\0';
    *strrchr(daemon_program, '/') = '\0';
    strcpy(strrchr(daemon_program, '/'), "/quadmeshd");
    assert_int_equal(access(daemon_program, X_OK), 0);
}

static void use_child(const char *program)
{
    qm_draco_child_set_program(program);
    qm_codec_drc_set_decoder(qm_draco_child_decode);
}

static qm_text encode(const qm_mesh *mesh, int bits)
{
    qm_context ctx = qm_context_make();
    qm_mesh_facts facts;
    qm_encoder *encoder;
    qm_text file = {0};
    assert_int_equal(qm_mesh_find_facts(&ctx, mesh, &facts), QM_OK);
    assert_int_equal(qm_encoder_create(&ctx, mesh, &facts, QM_FORMAT_DRC, bits, NULL, &encoder), QM_OK);
    assert_false(qm_encoder_next(encoder, &file));
    qm_encoder_destroy(encoder);
    return file;
}

static void check_same(const qm_decoded *a, const qm_decoded *b)
{
    assert_int_equal(a->status, b->status);
    assert_int_equal(a->mesh.vertex_count, b->mesh.vertex_count);
    assert_int_equal(a->mesh.face_count, b->mesh.face_count);
    if (a->status != QM_OK) return;
    assert_memory_equal(a->mesh.positions, b->mesh.positions, 24 * a->mesh.vertex_count);
    if (a->mesh.face_count > 0) assert_memory_equal(a->mesh.faces, b->mesh.faces, 16 * a->mesh.face_count);
    assert_int_equal(a->report.warning_count, b->report.warning_count);
    for (size_t i = 0; i < a->report.warning_count; i++)
        assert_string_equal(a->report.warnings[i], b->report.warnings[i]);
}

static void test_a_child_decodes_the_same(void **state)
{
    (void)state;
    find_daemon();
    qm_random random = qm_random_make(qm_check_seed(), 5);
    qm_mesh meshes[] = {qm_shape_torus(30, 20, 3, 1), qm_shape_points(&random, 100), qm_shape_box(1, 2, 3),
                        qm_shape_soup(&random, 40, QM_SOUP_TRIANGLES, QM_SOUP_POOLED, 0)};
    for (size_t i = 0; i < sizeof meshes / sizeof *meshes; i++)
        for (int bits = 0; bits <= 12; bits += 12) {
            qm_text file = encode(&meshes[i], bits);
            qm_codec_drc_set_decoder(qm_draco_decode);
            qm_decoded here = qm_decode(QM_FORMAT_DRC, file.data, file.size);
            use_child(daemon_program);
            qm_decoded there = qm_decode(QM_FORMAT_DRC, file.data, file.size);
            assert_int_equal(here.status, QM_OK);
            check_same(&here, &there);
            qm_decoded_free(&here);
            qm_decoded_free(&there);
            qm_text_reset(&file);
        }
    for (size_t i = 0; i < sizeof meshes / sizeof *meshes; i++)
        qm_shape_free(&meshes[i]);
}

/** Bytes turned over at random: what comes back is a mesh or a refusal, and no child stays behind. */
static void test_broken_files_hurt_the_child_alone(void **state)
{
    (void)state;
    find_daemon();
    use_child(daemon_program);
    qm_mesh mesh = qm_shape_torus(12, 8, 3, 1);
    qm_text file = encode(&mesh, 10);
    for (uint64_t test = 0; test < 60; test++) {
        qm_random random = qm_random_make(qm_check_seed(), 100 + test);
        char *broken = malloc(file.size);
        memcpy(broken, file.data, file.size);
        for (size_t k = 0; k <= test % 4; k++)
            broken[11 + qm_random_below(&random, file.size - 11)] ^=
                (char)(1 + qm_random_below(&random, 255));
        qm_decoded decoded = qm_decode(QM_FORMAT_DRC, broken, file.size);
        QM_CHECK(decoded.status != QM_E_NO_MEMORY, "test %d: %s", (int)test, decoded.report.detail);
        qm_decoded_free(&decoded);
        free(broken);
    }
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1);
    qm_text_reset(&file);
    qm_shape_free(&mesh);
}

/** Children that end early, by themselves or by a signal, or answer nothing; the last two have used up their limits. */
static void test_a_child_that_fails_is_a_broken_file(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        qm_status status;
    } cases[] = {{"exit 1", QM_E_FORMAT},
                 {"exit 0", QM_E_FORMAT},
                 {"kill -SEGV $$", QM_E_FORMAT},
                 {"exit 3", QM_E_TOO_LARGE},
                 {"kill -XCPU $$", QM_E_TOO_LARGE}};
    qm_mesh mesh = qm_shape_box(1, 1, 1);
    qm_text drc = encode(&mesh, 0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char script[] = "/tmp/quadmeshd-child-XXXXXX";
        int file = mkstemp(script);
        dprintf(file, "#!/bin/sh\n%s\n", cases[i].text);
        fchmod(file, 0700);
        close(file);
        use_child(script);
        qm_decoded decoded = qm_decode(QM_FORMAT_DRC, drc.data, drc.size);
        QM_CHECK(decoded.status == cases[i].status, "%s: %s", cases[i].text, qm_status_code(decoded.status));
        qm_decoded_free(&decoded);
        unlink(script);
    }
    use_child("/nowhere/at/all");
    qm_decoded decoded = qm_decode(QM_FORMAT_DRC, drc.data, drc.size);
    assert_int_equal(decoded.status, QM_E_NO_MEMORY);
    qm_decoded_free(&decoded);
    qm_text_reset(&drc);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_process_may_compute_and_nothing_else),
        cmocka_unit_test(test_the_time_of_the_processor_is_limited),
        cmocka_unit_test(test_a_child_decodes_the_same),
        cmocka_unit_test(test_broken_files_hurt_the_child_alone),
        cmocka_unit_test(test_a_child_that_fails_is_a_broken_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
