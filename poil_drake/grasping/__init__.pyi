from .execution_plan import ExecutionPlan as ExecutionPlan
