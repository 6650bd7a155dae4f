from jointscope.diagnosis.effects.spec import EffectSpec
SPECS: tuple[EffectSpec, ...] = ()
PAYLOAD = None
