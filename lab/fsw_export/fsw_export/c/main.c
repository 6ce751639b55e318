/* Example: reads the ticks of a weld from a CSV file, steps the controller, and writes the commands as CSV.
 *
 *   fsw_example [TICKS.csv [EXPECTED.csv]]     without arguments: all test vectors
 *
 * With EXPECTED.csv it compares instead of writing, and ends with 1 if an output differs by more than 1e-9. */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fsw_example.h"

#define LINE 4096
#define TOLERANCE 1e-9
#define COUNT(table) (sizeof(table) / sizeof(table[0]))

/* all memory of the controller; nothing is allocated */
static CONTROLLER controller;
static INPUT input;
static OUTPUT output;

static char line[LINE];
static double values[COUNT(INPUTS) + COUNT(OUTPUTS)];

#ifdef FSW_COUNTER /* instructions, for measurements: given by the board */
extern unsigned fsw_counter(void);
#endif

static void put(void *record, const column *c, double value) {
  char *at = (char *)record + c->offset;
  if (c->is_int) {
    const int whole = value > -1e9 && value < 1e9 ? (int)value : 0;
    memcpy(at, &whole, sizeof whole);
  } else {
    memcpy(at, &value, sizeof value);
  }
}

static double get(const void *record, const column *c) {
  const char *at = (const char *)record + c->offset;
  double value;
  int whole;
  if (!c->is_int) {
    memcpy(&value, at, sizeof value);
    return value;
  }
  memcpy(&whole, at, sizeof whole);
  return whole;
}

/* Whether a cell ends here: with a comma, or with the line. */
static int is_end(const char *at, int has_next) {
  return has_next ? *at == ',' : *at == '\n' || *at == '\r' || *at == '\0';
}

/* Whether the first line of a file names the columns in their order. */
static int has_header(FILE *file, const column *table, size_t n) {
  if (!fgets(line, LINE, file)) return 0;
  const char *at = line;
  for (size_t i = 0; i < n; i++) {
    const size_t length = strlen(table[i].name);
    if (strncmp(at, table[i].name, length) != 0) return 0;
    at += length;
    if (!is_end(at, i + 1 < n)) return 0;
    at++;
  }
  return 1;
}

/* Next row into values: 1, at the end of the file 0, -1 if it is wrong. */
static int read_row(FILE *file, size_t n) {
  if (!fgets(line, LINE, file)) return 0;
  char *at = line, *end;
  for (size_t i = 0; i < n; i++) {
    values[i] = strtod(at, &end);
    if (end == at || !is_end(end, i + 1 < n)) return -1;
    at = end + 1;
  }
  return 1;
}

static int differ(double value, double expected) {
  if (value == expected || (value != value && expected != expected)) return 0;
  return !(fabs(value - expected) <= TOLERANCE);
}

static void write_row(void) {
  for (size_t i = 0; i < COUNT(OUTPUTS); i++) printf(i ? ",%.17g" : "%.17g", get(&output, &OUTPUTS[i]));
}

/* How many outputs differ from the values; complains about each. */
static int compare_row(long row, double *largest, int complain) {
  int wrong = 0;
  for (size_t i = 0; i < COUNT(OUTPUTS); i++) {
    const double value = get(&output, &OUTPUTS[i]), off = fabs(value - values[i]);
    if (off > *largest) *largest = off;
    if (!differ(value, values[i])) continue;
    wrong++;
    if (complain)
      fprintf(stderr, "line %ld: %s is %.17g, expected %.17g\n", row + 1, OUTPUTS[i].name, value, values[i]);
  }
  return wrong;
}

static int run(FILE *ticks, FILE *expected) {
  double largest = 0.0;
  long row = 0;
  int status = 0, wrong = 0;
  if (!has_header(ticks, INPUTS, COUNT(INPUTS))) {
    fprintf(stderr, "ticks: the first line must name the columns of fsw_example.h\n");
    return 2;
  }
  if (expected && !has_header(expected, OUTPUTS, COUNT(OUTPUTS))) {
    fprintf(stderr, "expected: the first line must name the columns of fsw_example.h\n");
    return 2;
  }
  if (START(&controller)) {
    fprintf(stderr, "the tables do not fit what the library was compiled for\n");
    return 2;
  }
  for (size_t i = 0; !expected && i < COUNT(OUTPUTS); i++) printf(i ? ",%s" : "%s", OUTPUTS[i].name);
#ifdef FSW_COUNTER
  if (!expected) printf(",count");
#endif
  if (!expected) printf("\n");
  CLEAR(&input);
  while ((status = read_row(ticks, COUNT(INPUTS))) > 0) {
    for (size_t i = 0; i < COUNT(INPUTS); i++) put(&input, &INPUTS[i], values[i]);
    if (row++ == 0) RESET(&controller, &input); /* it starts from the set-points that are in force */
#ifdef FSW_COUNTER
    const unsigned before = fsw_counter();
#endif
    STEP(&controller, &input, &output);
#ifdef FSW_COUNTER
    const unsigned count = fsw_counter() - before;
#endif
    if (!expected) {
      write_row();
#ifdef FSW_COUNTER
      printf(",%u", count);
#endif
      printf("\n");
      continue;
    }
    if (read_row(expected, COUNT(OUTPUTS)) != 1) {
      fprintf(stderr, "expected: line %ld is missing or wrong\n", row + 1);
      return 2;
    }
    wrong += compare_row(row, &largest, wrong < 5);
  }
  if (status < 0) {
    fprintf(stderr, "ticks: line %ld is wrong\n", row + 2);
    return 2;
  }
  if (row == 0 || (expected && read_row(expected, COUNT(OUTPUTS)) != 0)) {
    fprintf(stderr, row ? "expected: more lines than ticks\n" : "ticks: no line\n");
    return 2;
  }
  if (expected) printf("%ld ticks, largest difference %.3g: %s\n", row, largest, wrong ? "FAILED" : "passed");
  return wrong != 0;
}

static int run_files(const char *ticks_name, const char *expected_name) {
  FILE *ticks = fopen(ticks_name, "r"), *expected = expected_name ? fopen(expected_name, "r") : NULL;
  int status = 2;
  if (!ticks)
    fprintf(stderr, "cannot read %s\n", ticks_name);
  else if (expected_name && !expected)
    fprintf(stderr, "cannot read %s\n", expected_name);
  else
    status = run(ticks, expected);
  if (ticks) fclose(ticks);
  if (expected) fclose(expected);
  return status;
}

int main(int argc, char **argv) {
  if (argc > 1) return run_files(argv[1], argc > 2 ? argv[2] : NULL);
  const int weld = run_files("vectors/weld.csv", "vectors/weld_expected.csv");
  const int faults = run_files("vectors/faults.csv", "vectors/faults_expected.csv");
  printf("memory: %lu bytes\n", (unsigned long)(sizeof controller + sizeof input + sizeof output));
  return weld > faults ? weld : faults;
}
