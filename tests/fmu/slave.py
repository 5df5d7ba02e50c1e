"""A slave through fmpy, spoken to by names."""

import shutil
from contextlib import contextmanager

import fmpy
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE


class Slave:
    """An instance of an FMI 2.0 FMU."""

    def __init__(self, path, name="one", token=None):
        self.about = fmpy.read_model_description(path)
        self.reference = {own.name: own.valueReference for own in self.about.modelVariables}
        self.folder = fmpy.extract(path)
        self.said = []
        self.fmu = FMU2Slave(
            guid=token or self.about.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.about.coSimulation.modelIdentifier,
            instanceName=name,
        )
        logger = fmi2CallbackLoggerTYPE(self._log)
        self.callbacks = fmi2CallbackFunctions(logger=logger)
        self.fmu.instantiate(callbacks=self.callbacks)
        self.time = 0.0

    def _log(self, environment, instance, status, category, message, *_):
        self.said.append((instance.decode(), status, message.decode()))

    def begin(self, time=0.0, **values):
        self.fmu.setupExperiment(startTime=time)
        self.set(values.pop("given", {}))
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.time = time
        return self

    def set(self, values):
        if values:
            self.fmu.setReal([self.reference[name] for name in values], list(values.values()))

    def slope(self, values):
        self.fmu.setRealInputDerivatives(
            [self.reference[name] for name in values], [1] * len(values), list(values.values())
        )

    def step(self, span):
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=span)
        self.time += span

    def get(self, names):
        return self.fmu.getReal([self.reference[name] for name in names])

    def close(self):
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def slave(path, **options):
    own = Slave(path, **options)
    try:
        yield own
    finally:
        own.close()
