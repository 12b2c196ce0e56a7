/*
 * prove: draws cases by class, queries the engine, and compares its answers with certified
 * references.
 *
 *   prove [--seconds S] [--seed N] [--jobs N] [CLASS ...]     all classes, or those whose names begin so
 *   prove --seed N --index I CLASS                            one case again
 *
 * Prints a line for each class: tries, failures and the seed. Exit status: 0 when nothing failed, 1
 * otherwise, 2 for wrong usage.
 */
#include "ask.h"

#include <getopt.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { MAX_JOBS = 64, SHOWN = 2, PRINTED = 12, LONGEST_CASE = 60 };
enum { MOST_BARREN = 1000 }; /* cases without a try, after which a class has failed */

typedef struct family {
    const char *name;
    qm_ask *ask;
    int share; /* of the time */
    bool needs_ties;
} family;

static const family families[] = {
    {"hausdorff", qm_ask_hausdorff, 4, false},
    {"project", qm_ask_project, 2, false},
    {"ties", qm_ask_ties, 1, true},
    {"deviation", qm_ask_deviation, 1, false},
};
enum { FAMILIES = sizeof families / sizeof *families };

typedef struct errand {
    double seconds; /* for all classes */
    uint64_t seed, index;
    bool has_index;
    int jobs;
    char **names; /* beginnings of classes; none: all */
    int name_count;
} errand;

/** What a job shares with its parent. */
typedef struct progress {
    qm_tally tally;
    uint64_t index; /* of the current case */
} progress;

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* ---- one case ---- */

static void print_mesh(const char *name, const qm_mesh *mesh)
{
    printf("# %s.obj\n", name);
    for (size_t v = 0; v < mesh->vertex_count; v++)
        printf("v %.17g %.17g %.17g\n", mesh->positions[3 * v], mesh->positions[3 * v + 1],
               mesh->positions[3 * v + 2]);
    for (size_t f = 0; f < mesh->face_count; f++) {
        printf("f");
        for (int i = 0; i < 4; i++)
            if (mesh->faces[4 * f + (size_t)i] != QM_NO_INDEX)
                printf(" %u", mesh->faces[4 * f + (size_t)i] + 1);
        printf("\n");
    }
}

void qm_trial_fail(qm_trial *trial, const char *format, ...)
{
    bool is_first = trial->is_shown;
    trial->tally->failures++;
    trial->is_shown = false; /* the meshes once a case */
    if (trial->tally->failures > PRINTED) return;
    va_list arguments;
    va_start(arguments, format);
    printf("FAILED %s/%s: ", trial->family, trial->kind->name);
    vprintf(format, arguments);
    printf("\n    again: prove --seed %llu --index %llu %s/%s\n", (unsigned long long)trial->seed,
           (unsigned long long)trial->index, trial->family, trial->kind->name);
    va_end(arguments);
    if (is_first) {
        print_mesh("A", &trial->pair.a);
        print_mesh("B", &trial->pair.b);
    }
    fflush(stdout);
}

static bool build_trees(qm_trial *trial)
{
    const qm_mesh *const meshes[] = {&trial->pair.a, &trial->pair.b};
    for (int i = 0; i < 2; i++) {
        qm_status status = qm_mesh_validate(&trial->ctx, meshes[i]);
        if (status == QM_OK) status = qm_bvh_build(&trial->ctx, meshes[i], QM_BVH_ALL, 1, &trial->tree[i]);
        if (status == QM_OK) continue;
        qm_trial_fail(trial, "%s: %s", qm_status_code(status), trial->ctx.message);
        return false;
    }
    return true;
}

static void run_case(const family *group, const qm_case_kind *kind, const errand *plan, uint64_t index,
                     qm_tally *tally)
{
    qm_trial trial = {
        .family = group->name, .kind = kind, .seed = plan->seed, .index = index, .tally = tally};
    trial.ctx = qm_context_make();
    trial.is_shown = tally->failures < SHOWN;
    trial.random = qm_random_make(plan->seed, index);
    trial.pair = kind->draw(&trial.random);
    trial.frame = qm_wide_frame_make(&trial.pair.a, &trial.pair.b);
    trial.size = (double)(1 / trial.frame.scale);
    tally->cases++;
    if (build_trees(&trial)) group->ask(&trial);
    for (int i = 0; i < 2; i++)
        qm_bvh_destroy(&trial.ctx, trial.tree[i]);
    qm_shape_free(&trial.pair.a);
    qm_shape_free(&trial.pair.b);
}

/* ---- a class ---- */

/** As many cases as the time allows; longer on a busy machine where none of them came to a try yet. */
static void run_job(const family *group, const qm_case_kind *kind, const errand *plan, int job,
                    double seconds, progress *shared)
{
    double end = now() + seconds;
    for (uint64_t index = (uint64_t)job; now() < end || (shared->tally.tries == 0 && index < MOST_BARREN);
         index += (uint64_t)plan->jobs) {
        shared->index = index;
        /* Whatever does not end by then ends the job; processor time, so that a busy machine makes no
         * difference. */
        setitimer(ITIMER_PROF, &(struct itimerval){.it_value.tv_sec = LONGEST_CASE}, NULL);
        run_case(group, kind, plan, index, &shared->tally);
    }
    fflush(stdout);
}

static void add_tally(qm_tally *sum, const qm_tally *one)
{
    sum->cases += one->cases;
    sum->tries += one->tries;
    sum->failures += one->failures;
    sum->open += one->open;
    sum->refused += one->refused;
}

/** Runs a class in processes of its own, so that a crash or a case that does not end is a failure like
 * others. */
static qm_tally run_class(const family *group, const qm_case_kind *kind, const errand *plan, double seconds,
                          progress shared[MAX_JOBS])
{
    pid_t child[MAX_JOBS];
    qm_tally sum = {0};
    memset(shared, 0, (size_t)plan->jobs * sizeof *shared);
    fflush(stdout);
    for (int job = 0; job < plan->jobs; job++) {
        child[job] = fork();
        if (child[job] == 0) {
            run_job(group, kind, plan, job, seconds, &shared[job]);
            _exit(0);
        }
    }
    for (int job = 0; job < plan->jobs; job++) {
        int status = 0;
        if (child[job] < 0 || waitpid(child[job], &status, 0) < 0 || status != 0) {
            printf("FAILED %s/%s: ended by signal %d\n    again: prove --seed %llu --index %llu %s/%s\n",
                   group->name, kind->name, WIFSIGNALED(status) ? WTERMSIG(status) : 0,
                   (unsigned long long)plan->seed, (unsigned long long)shared[job].index, group->name,
                   kind->name);
            sum.failures++;
        }
        add_tally(&sum, &shared[job].tally);
    }
    return sum;
}

static bool is_wanted(const errand *plan, const family *group, const qm_case_kind *kind)
{
    char name[64];
    if (group->needs_ties && kind->has_no_ties) return false;
    snprintf(name, sizeof name, "%s/%s", group->name, kind->name);
    for (int i = 0; i < plan->name_count; i++)
        if (strncmp(name, plan->names[i], strlen(plan->names[i])) == 0) return true;
    return plan->name_count == 0;
}

static int class_share(const family *group, const qm_case_kind *kind)
{
    return group->share * (kind->share > 0 ? kind->share : 1);
}

static int run(const errand *plan)
{
    int wanted = 0;
    uint64_t failures = 0;
    for (int f = 0; f < FAMILIES; f++)
        for (size_t k = 0; k < qm_case_kind_count; k++)
            if (is_wanted(plan, &families[f], &qm_case_kinds[k]))
                wanted += class_share(&families[f], &qm_case_kinds[k]);
    if (wanted == 0) {
        fprintf(stderr, "prove: no such class\n");
        return 2;
    }
    progress *shared =
        mmap(NULL, MAX_JOBS * sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) abort();
    for (int f = 0; f < FAMILIES; f++)
        for (size_t k = 0; k < qm_case_kind_count; k++) {
            if (!is_wanted(plan, &families[f], &qm_case_kinds[k])) continue;
            qm_tally sum = {0};
            double seconds = plan->seconds * class_share(&families[f], &qm_case_kinds[k]) / wanted;
            if (plan->has_index)
                run_case(&families[f], &qm_case_kinds[k], plan, plan->index, &sum);
            else
                sum = run_class(&families[f], &qm_case_kinds[k], plan, seconds, shared);
            failures += sum.failures;
            if (sum.tries == 0) failures++; /* a class without tries proves nothing */
            printf("%s %s/%s: %llu tries, %llu failures, seed %llu (%llu cases, %llu open, %llu refused)\n",
                   sum.failures || sum.tries == 0 ? "FAILED" : "ok", families[f].name, qm_case_kinds[k].name,
                   (unsigned long long)sum.tries, (unsigned long long)sum.failures,
                   (unsigned long long)plan->seed, (unsigned long long)sum.cases,
                   (unsigned long long)sum.open, (unsigned long long)sum.refused);
            fflush(stdout);
        }
    return failures > 0;
}

int main(int argc, char **argv)
{
    static const struct option known[] = {{"seconds", required_argument, NULL, 's'},
                                          {"seed", required_argument, NULL, 'n'},
                                          {"index", required_argument, NULL, 'i'},
                                          {"jobs", required_argument, NULL, 'j'},
                                          {NULL, 0, NULL, 0}};
    errand plan = {.seconds = 900, .seed = 1, .jobs = 2};
    for (int option; (option = getopt_long(argc, argv, "", known, NULL)) != -1;) {
        if (option == 's') plan.seconds = atof(optarg);
        if (option == 'n') plan.seed = strtoull(optarg, NULL, 0);
        if (option == 'j') plan.jobs = atoi(optarg);
        if (option == 'i') {
            plan.index = strtoull(optarg, NULL, 0);
            plan.has_index = true;
        }
        if (option == '?') return 2;
    }
    if (plan.jobs < 1 || plan.jobs > MAX_JOBS || !(plan.seconds > 0)) {
        fprintf(stderr, "prove: --jobs is 1 to %d, --seconds more than 0\n", MAX_JOBS);
        return 2;
    }
    plan.names = argv + optind;
    plan.name_count = argc - optind;
    return run(&plan);
}
