/* Start of a Cortex-M7 under QEMU: FPU on, then newlib's start with semihosting for files; and a counter of instructions.
 * Part of the example only. */
#define REGISTER(address) (*(volatile unsigned *)(address))
#define CPACR REGISTER(0xE000ED88u)
#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)

extern void _start(void);
extern void _exit(int status);
extern unsigned __stack;
unsigned fsw_counter(void);
void reset(void);

/* Ticks of the processor's clock of 25 MHz since the start; 24 bits. */
unsigned fsw_counter(void) { return 0xFFFFFFu - SYSTICK_VALUE; }

void reset(void) {
  CPACR |= 0xFu << 20; /* coprocessors 10 and 11: the FPU */
  __asm volatile("dsb\nisb");
  SYSTICK_RELOAD = 0xFFFFFFu;
  SYSTICK_VALUE = 0;
  SYSTICK_CONTROL = 5u; /* on, the processor's clock */
  _start();
}

static void fault(void) { _exit(3); }

const struct {
  unsigned *stack;
  void (*handler[6])(void); /* reset, NMI and faults */
} vectors __attribute__((section(".vectors"), used)) = {&__stack, {reset, fault, fault, fault, fault, fault}};
