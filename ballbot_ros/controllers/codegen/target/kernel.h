/* The part of the OSEK kernel's interface that the generated program uses. */
#ifndef KERNEL_H
#define KERNEL_H

typedef unsigned char StatusType;
typedef unsigned char CounterType;

#define DeclareTask(name) void TaskMain_##name(void)
#define TASK(name) void TaskMain_##name(void)
#define DeclareCounter(name) extern const CounterType name

StatusType SignalCounter(CounterType counter);

/* Here a task ends when its function returns; in the generated program it is the last call. */
#define TerminateTask() ((void)0)

#endif
