/* Preloaded, it lets the nth write into a folder fail.

   STRIKE_IN: the folder. STRIKE_LOG: a file elsewhere that grows by a byte with each such write,
   over all threads and processes. STRIKE_NTH: which fails, from 1. STRIKE_ERROR: its errno. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef ssize_t Write(int, const void *, size_t);

static long counted(int fd, Write *real) /* which write into the folder this is; 0: into none */
{
    char link[40], target[4096];
    const char *folder = getenv("STRIKE_IN");
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t size = readlink(link, target, sizeof target);
    if (!folder || size < (ssize_t)strlen(folder) || strncmp(target, folder, strlen(folder)))
        return 0;
    int log = open(getenv("STRIKE_LOG"), O_WRONLY | O_CREAT | O_APPEND, 0666);
    real(log, "x", 1);
    long count = lseek(log, 0, SEEK_CUR);
    close(log);
    return count;
}

ssize_t write(int fd, const void *data, size_t size)
{
    Write *real = (Write *)dlsym(RTLD_NEXT, "write");
    int before = errno;
    long count = counted(fd, real);
    errno = before;
    if (count && count == atol(getenv("STRIKE_NTH"))) {
        errno = atoi(getenv("STRIKE_ERROR"));
        return -1;
    }
    return real(fd, data, size);
}
