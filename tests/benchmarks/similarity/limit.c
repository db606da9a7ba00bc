/* The square-root rate of one core: what bounds the distance of poses.
   cc -O3 -march=native -fno-math-errno -fno-trapping-math limit.c -o limit -lm */
#include <math.h>
#include <stdio.h>
#include <time.h>

#define LANES 512
#define ROUNDS 400000L

static double seconds(void) {
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(void) {
  static float a[LANES] __attribute__((aligned(64)));
  for (int i = 0; i < LANES; i++) a[i] = 1.5f + i;
  double begin = seconds();
  for (long r = 0; r < ROUNDS; r++) {
    for (int i = 0; i < LANES; i++) a[i] = sqrtf(a[i]);
    __asm__ volatile("" ::"r"(a) : "memory");
  }
  printf("%.6g\n", ROUNDS * LANES / (seconds() - begin));
  return 0;
}
