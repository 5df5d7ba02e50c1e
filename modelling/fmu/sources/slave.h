/* What both kinds of motion begin with: what the library shows, the phases of a slave's life. */
#include <stdarg.h>
#include <stdio.h>

#define MESSAGE 400

/* what is seen outside the library; all else is static */
#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;
