/* SPDX-License-Identifier: MIT
 *
 * What a start of many nonholonomic rows may cost: 200 skates beside each other, sin(a) xd - cos(a) yd = 0 for each, as they are,
 * with a row that is the sum of two others, and from a start that is assembled. A process for each, whose largest memory is
 * measured: 50 MB are allowed, of which the libraries take some 20. Time is not measured, since a busy machine decides on it: that
 * the work is bounded is counted by the suite `large`. "ok NAME" or "not ok NAME" for each, as interface.c.
 */
#define _DEFAULT_SOURCE
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <tandem.h>
#include <unistd.h>

enum { SKATES = 200, COORDINATES = 3 * SKATES, PLAIN = 0, REDUNDANT = 1, ASSEMBLED = 2 };

static int rows(double t, const double *q, double *value, void *data)
{
    int redundant = *(int *)data == REDUNDANT;
    (void)t;
    memset(value, 0, sizeof *value * (SKATES + redundant) * COORDINATES);
    for (int i = 0; i < SKATES; i++) {
        value[i * COORDINATES + 3 * i] = sin(q[3 * i + 2]);
        value[i * COORDINATES + 3 * i + 1] = -cos(q[3 * i + 2]);
    }
    for (int j = 0; redundant && j < COORDINATES; j++)
        value[SKATES * COORDINATES + j] = 0.5 * value[17 * COORDINATES + j] - 2 * value[90 * COORDINATES + j];
    return 0;
}

static int acceleration(double t, const double *q, const double *qd, double *value, void *data)
{
    (void)t;
    for (int i = 0; i < SKATES; i++)
        value[i] = qd[3 * i + 2] * (cos(q[3 * i + 2]) * qd[3 * i] + sin(q[3 * i + 2]) * qd[3 * i + 1]);
    if (*(int *)data == REDUNDANT) value[SKATES] = 0.5 * value[17] - 2 * value[90];
    return 0;
}

static int mass(double t, const double *q, double *value, void *data)
{
    (void)t, (void)q, (void)data;
    memset(value, 0, sizeof *value * COORDINATES * COORDINATES);
    for (int i = 0; i < COORDINATES; i++) value[i * COORDINATES + i] = i % 3 == 2 ? 0.2 : 1;
    return 0;
}

static int force(double t, const double *q, const double *qd, double *value, void *data)
{
    (void)t, (void)q, (void)qd, (void)data;
    for (int i = 0; i < COORDINATES; i++) value[i] = i % 3 == 0 ? 2.9 : 0;
    return 0;
}

/* Start; 0 where the start is as it should be. */
static int start(int kind)
{
    double q[COORDINATES] = {0}, qd[COORDINATES] = {0}, redundant = -1;
    tandem_problem *p = tandem_new(COORDINATES, 0, SKATES + (kind == REDUNDANT), &kind);
    int status;

    for (int i = 0; i < SKATES; i++) {
        q[3 * i + 2] = 0.1 * (i + 1);
        qd[3 * i + 2] = 1;
        if (kind == ASSEMBLED) qd[3 * i] = 0.1;
    }
    tandem_set_position_function(p, "nonholonomic_jacobian", rows);
    tandem_set_motion_function(p, "constraint_acceleration", acceleration);
    tandem_set_position_function(p, "mass_matrix", mass);
    tandem_set_motion_function(p, "applied_force", force);
    tandem_set_integer(p, "constant_mass", 1);
    status = kind == ASSEMBLED ? tandem_assemble(p, 0, q, qd) : 0;
    if (status == 0) status = tandem_start(p, 0, q, qd);
    if (status != 0) printf("    %s\n", tandem_message(p));
    tandem_get_statistic(p, "n_redundant", &redundant);
    tandem_free(p);
    return status != 0 || redundant != (kind == REDUNDANT);
}

static int check(const char *what, const char *kind, int passed, double value, const char *unit)
{
    printf("%s %s-%s\n", passed ? "ok" : "not ok", what, kind);
    printf("    %.3g %s\n", value, unit);
    return !passed;
}

int main(void)
{
    static const char *names[] = {"of-skates", "of-skates-with-a-redundant-row", "of-skates-that-are-assembled"};
    int failures = 0;

    for (int kind = PLAIN; kind <= ASSEMBLED; kind++) {
        struct rusage usage;
        int status;
        pid_t child;
        fflush(stdout);
        child = fork();
        if (child == 0) _exit(start(kind));
        if (child < 0 || wait4(child, &status, 0, &usage) != child) return 1;
        failures += check("the-start", names[kind], WIFEXITED(status) && WEXITSTATUS(status) == 0, status, "is its status");
        failures += check("the-memory", names[kind], usage.ru_maxrss < 50000, usage.ru_maxrss / 1000.0, "MB, allowed 50");
    }
    return failures != 0;
}
