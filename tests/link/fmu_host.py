"""An importer for tests: fmpy's bindings by variable name, FMI 2 and 3, arrays as arrays."""

import re
import shutil
import tempfile

import numpy as np

ARRAYS = re.compile(r"^(.+)\[[\d,]+\]$")


class Host:
    """One instance of an FMU. `log`: (status, text) of every message."""

    def __init__(self, file, *, start=None, name="one"):
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self.folder = tempfile.mkdtemp(prefix="fmu-host-")
        fmpy.extract(str(file), self.folder)
        self.model = fmpy.read_model_description(self.folder)
        self.is3 = self.model.fmiVersion.startswith("3")
        self.log, self.t = [], 0.0
        kind = FMU3Slave if self.is3 else FMU2Slave
        self.fmu = kind(
            guid=self.model.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.model.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.table, self.types = {}, {}
        for v in self.model.modelVariables:
            match = ARRAYS.match(v.name)
            base = match[1] if match else v.name
            self.table.setdefault(base, []).append(v.valueReference)
            self.types[base] = v.type
        try:
            if self.is3:
                self.fmu.instantiate(logMessage=self._note3, loggingOn=True)
            else:
                self.calls = self._callbacks()  # must live as long as the instance
                self.fmu.instantiate(callbacks=self.calls, loggingOn=True)
        except Exception as error:
            raise RuntimeError(f"{error}: {self.log}") from error
        self.begin(start or {})

    def begin(self, start):
        """The initialisation, with these values."""
        self.t = 0.0
        if not self.is3:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        for name, value in start.items():
            self[name] = value
        self.fmu.exitInitializationMode()

    def __setitem__(self, name, value):
        kind, refs = self.types[name], self.table[name]
        values = np.ravel(value).tolist()
        if self.is3 and kind == "Float64":
            self.fmu.setFloat64(refs, values)
        else:
            getattr(self.fmu, f"set{kind}")(refs, values)

    def __getitem__(self, name):
        kind, refs = self.types[name], self.table[name]
        if self.is3:
            shape = next(v.shape for v in self.model.modelVariables if v.name == name) or ()
            count = int(np.prod(shape, dtype=int))
            values = getattr(self.fmu, f"get{kind}")(refs, nValues=count) if count != 1 or shape else None
            if values is None:
                values = getattr(self.fmu, f"get{kind}")(refs)
        else:
            values = getattr(self.fmu, f"get{kind}")(refs)
        return values[0] if len(values) == 1 else np.array(values)

    def step(self, h):
        """One communication step [s]."""
        self.fmu.doStep(self.t, h)
        self.t += h

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _note3(self, environment, status, category, message):
        self.log.append((status, message.decode()))

    def _callbacks(self):
        from fmpy import fmi2

        def note(component, instance, status, category, message, *rest):
            self.log.append((status, message.decode()))

        made = fmi2.fmi2CallbackFunctions()
        made.logger = fmi2.fmi2CallbackLoggerTYPE(note)
        made.allocateMemory = fmi2.defaultCallbacks.allocateMemory
        made.freeMemory = fmi2.defaultCallbacks.freeMemory
        return made
